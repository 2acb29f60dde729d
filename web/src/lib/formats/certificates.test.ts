import { describe, expect, it } from 'vitest';

import type { PlanReport } from '../api/types';
import { certificateRows, clearanceBudget } from './certificates';

const REPORT: PlanReport = {
  length_m: 100, path_length_m: 99, duration_s: 95, mean_deviation_m: 0.1, max_deviation_m: 0.2, min_clearance_m: 1.9,
  max_speed_m_s: 4.9, max_acceleration_m_s2: 2.4, max_jerk_m_s3: 8, corridor_violation_m: 0, worst_viewpoint_miss_m: 0,
  viewpoints: 18, coverage: null, coverable: null, tour_cost: 95, tour_lower_bound: 90, tour_metric: 'time',
  energy_wh: 20, open_sky: 1, mission_items: null, stages_s: {},
};
const SAFETY = { clearance_m: 1, tracking_m: 0.5, position_m: 0.3, model_m: 0.1 };

describe('clearance budget', () => {
  it('is the sum of clearance and all errors', () => {
    const budget = clearanceBudget({ safety: SAFETY }, REPORT);
    expect(budget?.asked).toBeCloseTo(1.9);
    expect(budget?.kept).toBe(true);
  });

  it('is not kept by a plan that comes nearer', () => {
    expect(clearanceBudget({ safety: SAFETY }, { ...REPORT, min_clearance_m: 1.89 })?.kept).toBe(false);
  });

  it('is not made up when a part is not told', () => {
    expect(clearanceBudget({ safety: { clearance_m: 1 } }, REPORT)).toBeNull();
    expect(clearanceBudget({}, REPORT)).toBeNull();
  });
});

describe('rows', () => {
  const named = (scenario: Record<string, unknown> | null, report = REPORT) =>
    Object.fromEntries(certificateRows(report, scenario).map((row) => [row.name, row]));

  it('set the energy against the battery less its reserve', () => {
    const rows = named({ vehicle: { battery: { capacity_wh: 130, reserve: 0.25 } } });
    expect(rows['Energy']?.limit).toBe('≤ 97.5 Wh');
  });

  it('leave the limit empty when the scenario says none', () => {
    expect(named(null)['Speed']?.limit).toBe('');
  });

  it('tell which way to fly is predicted to be better, with both times and the reason', () => {
    const way = {
      time_s: 95, waits_s: 0, mean_deviation_m: 0.1, max_deviation_m: 0.4, min_clearance_m: 2, at_s: 3, finished: true,
      place_m: [0, 0, 0] as [number, number, number],
    };
    const prediction = {
      autopilot: 'px4', mission: { ...way, time_s: 190 }, offboard: way, mission_items: 30, needed_clearance_m: 1.4,
      choice: 'offboard' as const, why: 'much quicker', basis: 'usual settings',
    };
    const found = named(null, { ...REPORT, predictions: [prediction] })['On px4'];
    expect([found?.value, found?.limit, found?.about]).toEqual(['1:35', 'as offboard', 'offboard 1:35, mission 3:10: much quicker']);
    expect(named(null)['On px4']).toBeUndefined();
  });

  it('tell coverage only of surfaces', () => {
    expect(named(null)['Coverage']).toBeUndefined();
    expect(named(null, { ...REPORT, coverage: 0.5 })['Coverage']?.value).toBe('50.0 %');
  });
});
