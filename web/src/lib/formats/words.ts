/** Numbers and enumerations in the operator's words. Unknown is said, never shown as zero. */

export const UNKNOWN_TEXT = 'unknown';

/** A figure with its unit, or a dash when there is none. */
export function figure(value: number | null | undefined, unit: string, digits = 1): string {
  if (value === null || value === undefined) return '–';
  // A rounded zero has no sign.
  const text = value.toFixed(digits).replace(/^-(0(\.0*)?)$/, '$1');
  return unit ? `${text} ${unit}` : text;
}

export function percent(share: number | null | undefined, digits = 0): string {
  return share === null || share === undefined ? '–' : `${(100 * share).toFixed(digits)} %`;
}

/** Minutes and seconds, as 3:07. */
export function clock(seconds: number | null | undefined): string {
  if (seconds === null || seconds === undefined) return '–';
  const whole = Math.max(0, Math.round(seconds));
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, '0')}`;
}

/** Time of day (UTC) of an ISO 8601 timestamp. */
export function timeOfDay(iso: string | null | undefined): string {
  const match = iso ? /T(\d\d:\d\d:\d\d)/.exec(new Date(iso).toISOString()) : null;
  return match?.[1] ?? UNKNOWN_TEXT;
}

/** Underscores as blanks. */
export function plain(word: string): string {
  return word.replaceAll('_', ' ');
}

const FIX_NAMES = ['no GPS', 'no fix', '2D fix', '3D fix', 'DGPS', 'RTK float', 'RTK fixed', 'static', 'PPP'];

/** GPS_FIX_TYPE in words. */
export function fixName(fix: number): string {
  return FIX_NAMES[fix] ?? `fix type ${fix}`;
}

const SEVERITIES = ['emergency', 'alert', 'critical', 'error', 'warning', 'notice', 'info', 'debug'];

export function severityName(severity: number): string {
  return SEVERITIES[severity] ?? `severity ${severity}`;
}

/** The three looks of a severity. */
export function severityLook(severity: number): 'bad' | 'warn' | 'plain' {
  return severity <= 3 ? 'bad' : severity === 4 ? 'warn' : 'plain';
}
