import { describe, expect, it } from 'vitest';

import { offer, replan } from '../state/samples';
import { chainProblem, obstacleWords, offerWords, pieces, skippedViewpoints, viewpointWords } from './replans';

describe('replanning reports in words', () => {
  it('counts a viewpoint as skipped until a later report says that it was moved', () => {
    const fate = (viewpoint_id: number, fate: 'skipped' | 'moved') => ({ viewpoint_id, name: 'V', fate, position_m: null });
    const first = replan({ id: 1, viewpoints: [fate(3, 'skipped'), fate(4, 'skipped')] });
    const second = replan({ id: 2, viewpoints: [fate(4, 'moved')] });
    expect([...skippedViewpoints([second, first])]).toEqual([3]);
    const strange = replan({ id: 3, chain: 'unknown', viewpoints: [fate(0, 'skipped')] });
    expect([...skippedViewpoints([first, second, strange])]).toEqual([3]);
  });

  it('compares the piece of the plan with what was flown', () => {
    const left_out = { from_s: 61, to_s: 65.5, path_m: [], length_m: 8.04, duration_s: 4.5 };
    expect(pieces(replan({ left_out, path_m: [[0, 0, 5], [0, 9.26, 5]], flown_length_m: 9.26, flown_duration_s: 7 }))).toEqual({
      planned: '8.0 m in 4.5 s, from 1:01 to 1:06 of the plan',
      flown: '9.3 m in 7.0 s',
    });
    const gone = replan({ path_m: [[0, 0, 5], [0, 0, 9]], flown_length_m: 4, flown_duration_s: null });
    expect(pieces(gone)).toEqual({ planned: 'not known', flown: '4.0 m, never back on the plan' });
    expect(pieces(replan({ flown_duration_s: null }))).toEqual({ planned: '–', flown: 'no piece is told' });
  });

  it('says what is odd about the plan that was left', () => {
    expect(chainProblem(replan())).toBeNull();
    expect(chainProblem(replan({ chain: 'gap' }))).toContain('missing');
    expect(chainProblem(replan({ chain: 'unknown', plan_hash: 'ab12cd34ef' }))).toContain('ab12cd34…');
    expect(chainProblem(replan({ chain: 'unknown', plan_hash: '0000' }))).toContain('told none');
  });

  it('calls a viewpoint by its name, if the plan is known and has it', () => {
    const viewpoint = { viewpoint_id: 7, name: 'V', fate: 'skipped' as const, position_m: null };
    expect(viewpointWords(replan(), viewpoint)).toBe('V');
    expect(viewpointWords(replan(), { ...viewpoint, name: null })).toBe('viewpoint 7 that the plan does not have');
    expect(viewpointWords(replan({ chain: 'unknown' }), { ...viewpoint, name: null })).toBe('viewpoint 7 of that plan');
  });

  it('tells a standing obstacle from a moving one', () => {
    const obstacle = { position_m: [1, 2, 3] as [number, number, number], radius_m: 0.6, velocity_m_s: [3, 4] as [number, number] };
    expect(obstacleWords(obstacle)).toBe('moving at 5.0 m/s, 1.2 m wide, at 1.0 / 2.0 m');
    expect(obstacleWords({ ...obstacle, velocity_m_s: [0, 0] })).toMatch(/^standing/);
  });

  it('says how an offer stands', () => {
    expect(offerWords(offer({ state: 'offered', length_m: 120.4, duration_s: 61 }))).toBe('120 m in 1:01, from home');
    expect(offerWords(offer({ state: 'failed', failure: { title: '', message: 'no way', field: null } }))).toContain('no way');
    expect(offerWords(offer({ state: 'refused', decided_at: '2026-11-22T10:03:04Z' }))).toBe('refused 10:03:04');
    expect(offerWords(offer({ state: 'accepted', decided_at: '2026-11-22T10:03:04Z' }))).toContain('deleted since');
  });
});
