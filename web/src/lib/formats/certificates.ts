import type { PlanReport } from '../api/types';
import { clock, figure, percent } from './words';

/** A scenario as the plan carries it: checked by the station, so read here without checking again. */
export type ScenarioValues = Record<string, unknown>;

export interface BudgetPart {
  name: string;
  value: number;
  about: string;
}

export interface ClearanceBudget {
  parts: BudgetPart[];
  /** Sum of the parts (m). */
  asked: number;
  /** Whether the plan keeps it. */
  kept: boolean;
}

export interface CertificateRow {
  name: string;
  value: string;
  /** What it is measured against; empty when nothing. */
  limit: string;
  about: string;
}

const BUDGET: readonly [key: string, name: string, about: string][] = [
  ['clearance_m', 'clearance', 'Hull to any surface when everything goes wrong at once'],
  ['tracking_m', 'tracking', 'Flown against planned'],
  ['position_m', 'position', 'Error of the position fix'],
  ['model_m', 'model', 'Error of the mesh and of its placement'],
];
/** Figures in the reports are floating-point: a millimetre's millionth is no breach. */
const ROUNDING_M = 1e-6;

/** The number at a path of keys, or null. */
export function numberAt(values: unknown, ...path: string[]): number | null {
  let value = values;
  for (const key of path) {
    if (typeof value !== 'object' || value === null) return null;
    value = (value as ScenarioValues)[key];
  }
  return typeof value === 'number' ? value : null;
}

/** The error budget of the clearance and whether the plan keeps it; null when the scenario does not say all of it. */
export function clearanceBudget(scenario: ScenarioValues, report: PlanReport): ClearanceBudget | null {
  const parts = BUDGET.map(([key, name, about]) => ({ name, about, value: numberAt(scenario, 'safety', key) }));
  if (!parts.every((part): part is BudgetPart => part.value !== null)) return null;
  const asked = parts.reduce((sum, part) => sum + part.value, 0);
  return { parts, asked, kept: report.min_clearance_m >= asked - ROUNDING_M };
}

/** The figures of a plan beside the limits that the scenario set. */
export function certificateRows(report: PlanReport, scenario: ScenarioValues | null): CertificateRow[] {
  const limit = (value: number | null, unit: string, digits = 1) => (value === null ? '' : `≤ ${figure(value, unit, digits)}`);
  const capacity = numberAt(scenario, 'vehicle', 'battery', 'capacity_wh');
  const reserve = numberAt(scenario, 'vehicle', 'battery', 'reserve');
  const usable = capacity !== null && reserve !== null ? capacity * (1 - reserve) : null;
  const row = (name: string, value: string, limitText: string, about: string) => ({ name, value, limit: limitText, about });
  const costUnit = { length: 'm', time: 's' }[report.tour_metric] ?? '';
  return [
    row(
      'Viewpoints',
      String(report.viewpoints),
      report.viewpoints_lower_bound == null ? '' : `≥ ${Math.ceil(report.viewpoints_lower_bound - 1e-6)}`,
      'Places from which a picture is taken, at standstill; beside it the proved lower bound for the same candidates',
    ),
    ...(report.coverage === null
      ? []
      : [row('Coverage', percent(report.coverage, 1), 'of coverable', 'Share of the coverable sides that are seen as asked')]),
    ...(report.coverable === null
      ? []
      : [row('Coverable', percent(report.coverable, 1), 'of all', 'Share of all sides that a safe viewpoint can see')]),
    ...(report.max_blur_px == null
      ? []
      : [row('Blur', figure(report.max_blur_px, 'px', 2), '', 'Largest motion during an exposure, at the hover drift')]),
    ...(report.max_skew_px == null
      ? []
      : [row('Skew', figure(report.max_skew_px, 'px', 2), '', 'Largest motion while the shutter rolls over the picture')]),
    row('Duration', clock(report.duration_s), 'min', 'From take-off to landing'),
    row('Length', figure(report.length_m, 'm', 0), '', 'Of the trajectory'),
    row('Speed', figure(report.max_speed_m_s, 'm/s', 2), limit(numberAt(scenario, 'vehicle', 'max_speed_m_s'), 'm/s'), 'Highest on the curve'),
    row(
      'Acceleration',
      figure(report.max_acceleration_m_s2, 'm/s²', 2),
      limit(numberAt(scenario, 'vehicle', 'max_acceleration_m_s2'), 'm/s²'),
      'Highest on the curve',
    ),
    row('Energy', figure(report.energy_wh, 'Wh'), limit(usable, 'Wh'), 'Against the battery less its reserve'),
    row('Tour', figure(report.tour_cost, costUnit), `≥ ${figure(report.tour_lower_bound, costUnit)}`, 'Cost of the order, and the proved lower bound'),
    row('Deviation', figure(report.mean_deviation_m, 'm', 2), `max ${figure(report.max_deviation_m, 'm', 2)}`, 'Of the curve from the searched path'),
    row('Off corridor', figure(report.corridor_violation_m, 'm', 3), '', 'How far the curve leaves its boxes'),
    row('Miss', figure(report.worst_viewpoint_miss_m, 'm', 3), '≤ 0.05 m', 'Worst distance from a viewpoint'),
    row('Open sky', percent(report.open_sky), '', 'Share of the time with a clear straight climb above'),
    ...(report.tracking == null
      ? []
      : [
          row(
            'Tracking',
            figure(report.tracking.deviation_m, 'm', 2),
            limit(numberAt(scenario, 'safety', 'tracking_m'), 'm', 2),
            'Largest distance from the curve of a rigid body under a good controller in light gusts',
          ),
        ]),
    ...(report.predictions ?? []).map((p) => {
      const other = p.choice === 'mission' ? 'offboard' : 'mission';
      const times = `${p.choice} ${clock(p[p.choice].time_s)}, ${other} ${clock(p[other].time_s)}`;
      return row(`On ${p.autopilot}`, clock(p[p.choice].time_s), `as ${p.choice}`, `${times}: ${p.why}`);
    }),
    row('Items', report.mission_items === null ? '–' : String(report.mission_items), '', 'Items of the mission'),
  ];
}
