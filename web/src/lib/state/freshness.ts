import type { Reading } from '../api/types';

/** Telemetry comes several times a second; a vehicle not told of for this long is not shown as live. */
export const TELEMETRY_SILENCE_S = 3;

export interface Aged<T> {
  /** Null when it was never heard: unknown, which is not zero. */
  value: T | null;
  /** Seconds since the station heard it; null when unknown. */
  ageS: number | null;
  stale: boolean;
}

export const UNKNOWN: Aged<never> = { value: null, ageS: null, stale: true };

/**
 * How a reading stands now.
 *
 * @param reading as the station sent it; null when the vehicle never told.
 * @param sinceReceivedS seconds since the message with it arrived here.
 * @param live whether the stream from the station is alive.
 */
export function age<T>(reading: Reading<T> | null | undefined, sinceReceivedS: number, live: boolean): Aged<T> {
  if (!reading) return UNKNOWN;
  const waited = Math.max(0, sinceReceivedS);
  return {
    value: reading.value,
    ageS: reading.age_s + waited,
    stale: reading.stale || !live || waited > TELEMETRY_SILENCE_S,
  };
}

/** "now", "4 s ago", "3 min ago": how old something is, in few letters. */
export function ageText(ageS: number | null): string {
  if (ageS === null) return 'never';
  if (ageS < 1.5) return 'now';
  if (ageS < 99.5) return `${Math.round(ageS)} s ago`;
  if (ageS < 5400) return `${Math.round(ageS / 60)} min ago`;
  return `${Math.round(ageS / 3600)} h ago`;
}
