import { describe, expect, it } from 'vitest';

import { flight, plan, vehicle } from './samples';
import { chooseFlight, choosePlan, chooseVehicle } from './selection';

const known = (name: string, connected: boolean) => ({ info: vehicle({ name, connected }), receivedMs: 0 });

describe('vehicle', () => {
  it('is the chosen one, even when it is lost', () => {
    expect(chooseVehicle([known('a', true), known('b', false)], 'b')?.info.name).toBe('b');
  });

  it('is one that is heard when none was chosen', () => {
    expect(chooseVehicle([known('a', false), known('b', true)], null)?.info.name).toBe('b');
    expect(chooseVehicle([], 'a')).toBeNull();
  });
});

describe('plan', () => {
  const plans = [plan({ id: 'p3', state: 'failed' }), plan({ id: 'p2' }), plan({ id: 'p1' })];

  it('is the newest ready one by default, and the chosen one always', () => {
    expect(choosePlan(plans, [], 'px4-1', null)?.id).toBe('p2');
    expect(choosePlan(plans, [], 'px4-1', 'p3')?.id).toBe('p3');
  });

  it('is that of a flight that is going on', () => {
    expect(choosePlan(plans, [flight({ plan_id: 'p1', state: 'flying' })], 'px4-1', null)?.id).toBe('p1');
    expect(choosePlan(plans, [flight({ plan_id: 'p1', state: 'completed' })], 'px4-1', null)?.id).toBe('p2');
  });
});

describe('flight', () => {
  it('that owns the vehicle comes first, whatever plan is looked at', () => {
    const flights = [flight({ id: 'new', plan_id: 'p2' }), flight({ id: 'air', plan_id: 'p1', state: 'held' })];
    expect(chooseFlight(flights, 'px4-1', 'p2')?.id).toBe('air');
  });

  it('of another vehicle is never acted on', () => {
    expect(chooseFlight([flight({ state: 'flying' })], 'px4-2', 'p1')).toBeNull();
  });

  it('is the newest of this plan by this vehicle otherwise', () => {
    const flights = [flight({ id: 'b' }), flight({ id: 'a', state: 'completed' })];
    expect(chooseFlight(flights, 'px4-1', 'p1')?.id).toBe('b');
    expect(chooseFlight(flights, 'px4-1', 'p9')).toBeNull();
  });
});
