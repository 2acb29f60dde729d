import { describe, expect, it } from 'vitest';

import type { SigningInfo } from '../api/types';
import { signingWords } from './signing';

const SIGNED: SigningInfo = {
  rejects_unsigned: true, good: 900, unsigned: 0, wrong_key: 0, repeated: 0, past: 0, problem: null, rotated_at: null,
};

describe('signing in words', () => {
  it('tells a link without a key from one that is signed', () => {
    expect(signingWords(null).text).toBe('not signed');
    expect(signingWords(SIGNED)).toMatchObject({ text: 'signed', look: 'good' });
  });

  it('says when the key was rotated, and that is no fault', () => {
    const words = signingWords({ ...SIGNED, rotated_at: '2026-11-22T10:03:04Z' });
    expect(words).toMatchObject({ text: 'signed · key rotated 10:03:04', look: 'good' });
  });

  it('counts what was refused, and shows a present problem as one', () => {
    expect(signingWords({ ...SIGNED, unsigned: 3, wrong_key: 2 })).toMatchObject({ text: 'signed · 5 refused', look: 'warn' });
    expect(signingWords({ ...SIGNED, wrong_key: 1, problem: 'another key' }).look).toBe('bad');
  });

  it('does not call unsigned packets refused where they are taken', () => {
    const words = signingWords({ ...SIGNED, rejects_unsigned: false, unsigned: 4 });
    expect(words).toMatchObject({ text: 'signed · 4 unsigned taken', look: 'warn' });
    expect(words.detail).toContain('4 unsigned (taken)');
  });

  it('does not call a link signed on which nothing signed was heard', () => {
    expect(signingWords({ ...SIGNED, good: 0 })).toMatchObject({ text: 'no signed packet yet', look: 'warn' });
  });
});
