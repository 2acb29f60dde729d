import type { LeaseInfo } from '../api/types';
import { figure, percent } from './words';

/** A lease that was not told of for so long is not shown as the present; the companion tells twice a second. */
export const LEASE_SILENCE_S = 3;
/** Older scans are no longer flown by. */
const OLD_SCAN_S = 0.6;
const POOR_ODOMETRY = 30;

export interface Said {
  text: string;
  look: '' | 'good' | 'warn' | 'bad' | 'faint';
}

const LEADS: Record<LeaseInfo['state'], Said> = {
  idle: { text: 'the companion prepares', look: '' },
  refused: { text: 'the companion refused', look: 'bad' },
  leading: { text: 'the companion leads', look: 'good' },
  paused: { text: 'the companion hovers by order', look: 'warn' },
  finished: { text: 'the companion has flown the plan', look: 'good' },
  ended: { text: 'the companion ended its lease', look: 'warn' },
  taken_over: { text: 'somebody else has the vehicle', look: 'bad' },
};

/** Who leads the vehicle; `ageS` since the station heard it. */
export function leadsWords(lease: LeaseInfo, ageS: number): Said {
  if (ageS <= LEASE_SILENCE_S) return LEADS[lease.state];
  return { text: `the companion is not heard for ${figure(ageS, 's', 0)}`, look: 'warn' };
}

/** Whether the plan is flown, and if not, why. */
export function planWords(lease: LeaseInfo): Said {
  if (lease.away !== null) return { text: `off the plan: ${lease.away}`, look: 'warn' };
  return lease.state === 'leading' ? { text: 'on the plan', look: 'good' } : { text: lease.text, look: '' };
}

/** Age of the last good scan. */
export function lidarWords(lease: LeaseInfo): Said {
  const { lidar_age_s: age } = lease;
  if (age === null) return { text: 'no scan', look: 'bad' };
  return { text: `${figure(age, 's')} old`, look: age <= OLD_SCAN_S ? 'good' : 'bad' };
}

/** Health of the lidar's own odometry. */
export function odometryWords(lease: LeaseInfo): Said {
  const { odometry_quality: quality } = lease;
  if (quality === null) return { text: 'none', look: 'faint' };
  if (quality === 0) return { text: 'quality not told', look: '' };
  return { text: percent(quality / 100), look: quality < POOR_ODOMETRY ? 'warn' : 'good' };
}

/** Reports that have not come whole to the station. */
export function pendingWords(lease: LeaseInfo): Said {
  const { reports_pending: count } = lease;
  return count === 0 ? { text: 'none', look: 'good' } : { text: `${count} on board`, look: 'warn' };
}
