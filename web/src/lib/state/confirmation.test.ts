import { describe, expect, it } from 'vitest';

import { HOLD_MS, HoldToConfirm, mayProceed, namesVehicle } from './confirmation';

describe('naming the vehicle', () => {
  it('takes the name in any case with blanks around it', () => {
    expect(namesVehicle(' PX4-1 ', 'px4-1')).toBe(true);
  });

  it.each(['', ' ', 'px4', 'px4-11', 'px4-2', '1'])('does not take "%s" for px4-1', (typed) => {
    expect(namesVehicle(typed, 'px4-1')).toBe(false);
  });
});

describe('whether an action may be sent', () => {
  const questions = [
    { name: 'NAV_DLL_ACT', detail: '' },
    { name: 'COM_LOW_BAT_ACT', detail: '' },
  ];

  it('needs every failsafe accepted by its own name', () => {
    expect(mayProceed('px4-1', 'px4-1', questions, new Set())).toBe(false);
    expect(mayProceed('px4-1', 'px4-1', questions, new Set(['NAV_DLL_ACT']))).toBe(false);
    expect(mayProceed('px4-1', 'px4-1', questions, new Set(['NAV_DLL_ACT', 'COM_LOW_BAT_ACT']))).toBe(true);
  });

  it('needs the name even when nothing is to be accepted', () => {
    expect(mayProceed('', 'px4-1', [], new Set())).toBe(false);
    expect(mayProceed('px4-1', 'px4-1', [], new Set())).toBe(true);
  });
});

describe('a button that must be held', () => {
  it('fires once when held long enough', () => {
    const hold = new HoldToConfirm();
    hold.press(1000);
    expect(hold.due(1000 + HOLD_MS - 1)).toBe(false);
    expect(hold.due(1000 + HOLD_MS)).toBe(true);
    expect(hold.due(1000 + 2 * HOLD_MS)).toBe(false);
  });

  it('does not fire after it was let go, and counts anew', () => {
    const hold = new HoldToConfirm();
    hold.press(0);
    hold.release();
    expect(hold.due(10 * HOLD_MS)).toBe(false);
    hold.press(10 * HOLD_MS);
    expect(hold.due(10 * HOLD_MS + 1)).toBe(false);
    expect(hold.fraction(10.5 * HOLD_MS)).toBeCloseTo(0.5);
  });

  it('never fires unpressed', () => {
    expect(new HoldToConfirm().due(1e9)).toBe(false);
  });
});
