import { describe, expect, it } from 'vitest';

import type { LiveMessage } from '../api/types';
import { flight, image, lease, plan, replan, snapshot, trackPoint, vehicle } from './samples';
import { NOTHING_KNOWN, applyLive, withRecords, type StationState } from './station_state';

const play = (messages: LiveMessage[], from: StationState = NOTHING_KNOWN) =>
  messages.reduce((state, message, i) => applyLive(state, message, 1000 * i), from);

const said = (number: number, at: string, text = 'x', severity = 6): LiveMessage => ({
  type: 'message',
  message: { number, vehicle: 'px4-1', at, severity, text },
});

describe('snapshot', () => {
  it('replaces what may have gone in the meantime', () => {
    const before = play([snapshot({ vehicles: [vehicle()], plans: [plan()], flights: [flight()] })]);
    const after = play([snapshot({ plans: [plan({ id: 'p2' })] })], before);
    expect(after.vehicles).toEqual([]);
    expect(after.plans.map((p) => p.id)).toEqual(['p2']);
    expect(after.flights).toEqual([]);
  });

  it('keeps what a flight recorded and the log', () => {
    const before = play([
      { type: 'track', flight_id: 'f1', points: [trackPoint(1)] },
      said(1, '2026-11-22T10:00:00Z'),
    ]);
    const after = play([snapshot({ reason: 'catch_up' })], before);
    expect(after.records['f1']?.track).toHaveLength(1);
    expect(after.log).toHaveLength(1);
  });
});

describe('telemetry', () => {
  it('is the latest of each vehicle, with its time of arrival', () => {
    const state = play([
      { type: 'telemetry', vehicle: vehicle({ name: 'px4-2', system_id: 2 }) },
      { type: 'telemetry', vehicle: vehicle() },
      { type: 'telemetry', vehicle: vehicle({ connected: false }) },
    ]);
    expect(state.vehicles.map((v) => [v.info.name, v.receivedMs])).toEqual([
      ['px4-1', 2000],
      ['px4-2', 0],
    ]);
    expect(state.vehicles[0]?.info.connected).toBe(false);
  });
});

describe('a lease', () => {
  it('is the latest of each flight, and what a snapshot does not tell of is gone', () => {
    const told = play([
      snapshot({ leases: [lease(), lease({ flight_id: 'f2' })] }),
      { type: 'lease', lease: lease({ state: 'taken_over' }) },
    ]);
    expect(Object.entries(told.leases).map(([id, { info, receivedMs }]) => [id, info.state, receivedMs])).toEqual([
      ['f1', 'taken_over', 1000],
      ['f2', 'leading', 0],
    ]);
    expect(play([snapshot()], told).leases).toEqual({});
  });
});

describe('what belongs to a flight', () => {
  it('has every track point once and in order, whether live or read again', () => {
    const live = play([{ type: 'track', flight_id: 'f1', points: [trackPoint(3), trackPoint(4)] }]);
    const filled = withRecords(live, 'f1', { track: [1, 2, 3].map(trackPoint) });
    expect(filled.records['f1']?.track.map((p) => p.at_s)).toEqual([1, 2, 3, 4]);
  });

  it('shows the newest state of an image', () => {
    const state = play([
      { type: 'image', image: image() },
      { type: 'image', image: image({ state: 'stored' }) },
    ]);
    expect(state.records['f1']?.images.map((i) => i.state)).toEqual(['stored']);
  });

  it('counts a detour once that is told twice', () => {
    const state = play([
      { type: 'replan', replan: replan() },
      { type: 'replan', replan: replan() },
      { type: 'replan', replan: replan({ id: 2 }) },
    ]);
    expect(state.records['f1']?.replans.map((r) => r.id)).toEqual([2, 1]);
  });

  it('is not mixed with another flight', () => {
    const state = play([
      { type: 'image', image: image() },
      { type: 'image', image: image({ flight_id: 'f2' }) },
    ]);
    expect(Object.keys(state.records)).toEqual(['f1', 'f2']);
  });

  it('shows an upload only while it runs', () => {
    const uploading = play([
      { type: 'flight', flight: flight({ state: 'uploading' }) },
      { type: 'upload', flight_id: 'f1', phase: 'sending', fraction: 0.5 },
    ]);
    expect(uploading.uploads['f1']?.fraction).toBe(0.5);
    const failed = play([{ type: 'flight', flight: flight({ state: 'upload_failed' }) }], uploading);
    expect(failed.uploads).toEqual({});
    expect(failed.flights).toHaveLength(1);
  });
});

describe('log', () => {
  it('has the newest first and nothing twice', () => {
    const state = play([
      said(1, '2026-11-22T10:00:00Z', 'first'),
      said(2, '2026-11-22T10:00:01Z', 'second'),
      said(1, '2026-11-22T10:00:00Z', 'first'),
    ]);
    expect(state.log.map((l) => l.text)).toEqual(['second', 'first']);
  });

  it('keeps messages apart whose numbers repeat after a restart of the station', () => {
    const state = play([said(1, '2026-11-22T10:00:00Z'), said(1, '2026-11-22T11:00:00Z')]);
    expect(state.log).toHaveLength(2);
  });

  it('does not grow without bound', () => {
    const state = play(Array.from({ length: 700 }, (_, i) => said(i, `2026-11-22T10:00:00.${String(i).padStart(3, '0')}Z`)));
    expect(state.log).toHaveLength(500);
    expect(state.log[0]?.key).toContain('699');
  });
});

describe('plans', () => {
  it('follow their job', () => {
    const job = { id: 'j', plan_id: 'p1', state: 'running', stage: 'tour', fraction: 0.3, created_at: '', finished_at: null } as const;
    const state = play([snapshot({ plans: [plan({ state: 'planning' }), plan({ id: 'p2' })] }), { type: 'job', job }]);
    expect(state.plans.find((p) => p.id === 'p1')?.job?.fraction).toBe(0.3);
    expect(state.plans.find((p) => p.id === 'p2')?.job).toBeNull();
  });

  it('go when they are deleted', () => {
    const state = play([snapshot({ plans: [plan()] }), { type: 'plan_deleted', plan_id: 'p1' }]);
    expect(state.plans).toEqual([]);
  });
});

describe('links', () => {
  it('go when they are closed', () => {
    const link = { id: 'l', url: 'u', created_at: '', state: 'open', problem: null, messages_per_s: null, peers: [] } as const;
    const open = play([{ type: 'link', link: { ...link, peers: [] } }]);
    expect(open.links).toHaveLength(1);
    expect(play([{ type: 'link', link: { ...link, peers: [], state: 'closed' } }], open).links).toEqual([]);
  });
});
