import { describe, expect, it } from 'vitest';

import { lease } from '../state/samples';
import { LEASE_SILENCE_S, leadsWords, lidarWords, odometryWords, pendingWords, planWords } from './leases';

describe('a lease in words', () => {
  it('says who leads, and only as long as the companion is heard', () => {
    expect(leadsWords(lease(), 0.2)).toEqual({ text: 'the companion leads', look: 'good' });
    expect(leadsWords(lease({ state: 'taken_over' }), 0)).toEqual({ text: 'somebody else has the vehicle', look: 'bad' });
    expect(leadsWords(lease(), LEASE_SILENCE_S + 9)).toEqual({ text: 'the companion is not heard for 12 s', look: 'warn' });
  });

  it('says why the plan is left', () => {
    expect(planWords(lease({ away: 'a moving obstacle' }))).toEqual({ text: 'off the plan: a moving obstacle', look: 'warn' });
    expect(planWords(lease()).text).toBe('on the plan');
    expect(planWords(lease({ state: 'ended', text: 'the lidar is silent' })).text).toBe('the lidar is silent');
  });

  it('tells what is missing from what is bad', () => {
    expect(lidarWords(lease({ lidar_age_s: null }))).toEqual({ text: 'no scan', look: 'bad' });
    expect(lidarWords(lease({ lidar_age_s: 0.12 }))).toEqual({ text: '0.1 s old', look: 'good' });
    expect(lidarWords(lease({ lidar_age_s: 2 })).look).toBe('bad');
    expect(odometryWords(lease({ odometry_quality: null }))).toEqual({ text: 'none', look: 'faint' });
    expect(odometryWords(lease({ odometry_quality: 0 })).text).toBe('quality not told');
    expect(odometryWords(lease({ odometry_quality: 12 }))).toEqual({ text: '12 %', look: 'warn' });
    expect(pendingWords(lease())).toEqual({ text: 'none', look: 'good' });
    expect(pendingWords(lease({ reports_pending: 2 }))).toEqual({ text: '2 on board', look: 'warn' });
  });
});
