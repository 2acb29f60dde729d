import type { PlanOfferInfo, ReplanInfo } from '../api/types';
import { clock, figure, timeOfDay } from './words';

/** Viewpoints whose last word is that they were skipped; reports of a plan that nobody knows tell nothing of this one's. */
export function skippedViewpoints(replans: readonly ReplanInfo[]): Set<number> {
  const skipped = new Set<number>();
  for (const replan of replans.filter(({ chain }) => chain !== 'unknown').sort((a, b) => a.id - b.id)) {
    for (const { viewpoint_id, fate } of replan.viewpoints) {
      if (fate === 'skipped') skipped.add(viewpoint_id);
      else skipped.delete(viewpoint_id);
    }
  }
  return skipped;
}

/** What was planned and what was flown instead, in a line each. */
export function pieces(replan: ReplanInfo): { planned: string; flown: string } {
  const { left_out: piece, flown_length_m, flown_duration_s } = replan;
  if (replan.path_m.length === 0) return { planned: '–', flown: 'no piece is told' };
  const planned = piece
    ? `${figure(piece.length_m, 'm')} in ${figure(piece.duration_s, 's')}, from ${clock(piece.from_s)} to ${clock(piece.to_s)} of the plan`
    : 'not known';
  const took = flown_duration_s === null ? ', never back on the plan' : ` in ${figure(flown_duration_s, 's')}`;
  return { planned, flown: `${figure(flown_length_m, 'm')}${took}` };
}

/** What is odd about the plan that a report says it left; null when nothing is. */
export function chainProblem(replan: ReplanInfo): string | null {
  if (replan.chain === 'known') return null;
  if (replan.chain === 'gap') return 'A report before this one is missing.';
  const hash = /^0*$/.test(replan.plan_hash) ? 'it was told none' : `${replan.plan_hash.slice(0, 8)}…`;
  return `It left a plan that this station does not know (${hash}), so nothing is compared.`;
}

/** What a viewpoint of a report is called. */
export function viewpointWords(replan: ReplanInfo, { viewpoint_id, name }: ReplanInfo['viewpoints'][number]): string {
  return name ?? `viewpoint ${viewpoint_id} ${replan.chain === 'unknown' ? 'of that plan' : 'that the plan does not have'}`;
}

/** The obstacle in a few words. */
export function obstacleWords(obstacle: NonNullable<ReplanInfo['obstacle']>): string {
  const speed = Math.hypot(...obstacle.velocity_m_s);
  const [x, y] = obstacle.position_m;
  const moving = speed < 0.1 ? 'standing' : `moving at ${figure(speed, 'm/s')}`;
  return `${moving}, ${figure(2 * obstacle.radius_m, 'm')} wide, at ${figure(x, '')} / ${figure(y, 'm')}`;
}

/** How an offer stands, in a sentence. */
export function offerWords(offer: PlanOfferInfo): string {
  const what = offer.length_m === null ? '' : `${figure(offer.length_m, 'm', 0)} in ${clock(offer.duration_s)}`;
  switch (offer.state) {
    case 'planning':
      return 'is being made…';
    case 'offered':
      return `${what}, from home`;
    case 'accepted':
      return `accepted ${timeOfDay(offer.decided_at)}${offer.plan_id ? '' : ', deleted since'}`;
    case 'refused':
      return `refused ${timeOfDay(offer.decided_at)}`;
    case 'failed':
      return `there is none: ${offer.failure?.message ?? 'the reason is not known'}`;
    case 'superseded':
      return 'more was skipped after it was made';
  }
}
