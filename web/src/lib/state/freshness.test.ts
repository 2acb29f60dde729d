import { describe, expect, it } from 'vitest';

import { TELEMETRY_SILENCE_S, UNKNOWN, age, ageText } from './freshness';

const fresh = { value: 7, age_s: 0.5, stale: false };

describe('age of a reading', () => {
  it('grows while nothing new arrives', () => {
    expect(age(fresh, 2, true)).toEqual({ value: 7, ageS: 2.5, stale: false });
  });

  it('is stale when the station said so, even just received', () => {
    expect(age({ ...fresh, stale: true }, 0, true).stale).toBe(true);
  });

  it('is stale when the stream is lost, even just received', () => {
    expect(age(fresh, 0, false).stale).toBe(true);
  });

  it('is stale after the silence limit and not before', () => {
    expect(age(fresh, TELEMETRY_SILENCE_S - 0.01, true).stale).toBe(false);
    expect(age(fresh, TELEMETRY_SILENCE_S + 0.01, true).stale).toBe(true);
  });

  it('keeps false and zero apart from unknown', () => {
    expect(age({ value: false, age_s: 0, stale: false }, 0, true).value).toBe(false);
    expect(age({ value: 0, age_s: 0, stale: false }, 0, true).value).toBe(0);
    expect(age(null, 0, true)).toBe(UNKNOWN);
    expect(UNKNOWN.value).toBeNull();
  });

  it('never is younger than when it was sent', () => {
    expect(age(fresh, -5, true).ageS).toBe(0.5);
  });
});

describe('age in words', () => {
  it.each([
    [null, 'never'],
    [0.2, 'now'],
    [4.2, '4 s ago'],
    [180, '3 min ago'],
    [7200, '2 h ago'],
  ])('%s is "%s"', (seconds, text) => {
    expect(ageText(seconds)).toBe(text);
  });
});
