import { describe, expect, it } from 'vitest';

import { clock, figure, fixName, percent, timeOfDay } from './words';

describe('words', () => {
  it('says unknown as a dash, never as zero', () => {
    expect([figure(null, 'm'), percent(undefined), clock(null)]).toEqual(['–', '–', '–']);
    expect([figure(0, 'm'), percent(0), clock(0)]).toEqual(['0.0 m', '0 %', '0:00']);
  });

  it('writes no sign before a rounded zero', () => {
    expect(figure(-0.04, 'm')).toBe('0.0 m');
    expect(figure(-0.4, '', 0)).toBe('0');
    expect(figure(-0.06, 'm')).toBe('-0.1 m');
  });

  it('writes times', () => {
    expect(clock(187.4)).toBe('3:07');
    expect(timeOfDay('2026-11-22T10:04:05.7+02:00')).toBe('08:04:05');
    expect(timeOfDay(null)).toBe('unknown');
  });

  it('names fixes, also those it does not know', () => {
    expect(fixName(3)).toBe('3D fix');
    expect(fixName(42)).toBe('fix type 42');
  });
});
