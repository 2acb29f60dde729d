import type { SigningInfo } from '../api/types';
import { timeOfDay } from './words';

/** How a link's signing goes, in a word or two. */
export interface SigningWords {
  text: string;
  look: 'good' | 'warn' | 'bad' | 'faint';
  /** One sentence more, for the tooltip. */
  detail: string;
}

/** Signing of a link in the operator's words; null is a link without a key. */
export function signingWords(signing: SigningInfo | null | undefined): SigningWords {
  if (!signing) return { text: 'not signed', look: 'faint', detail: 'This link has no key: anybody on it can speak for the vehicle.' };
  const refused = signing.wrong_key + signing.repeated + signing.past + (signing.rejects_unsigned ? signing.unsigned : 0);
  const detail =
    `${signing.good} packets signed with our key, ${signing.unsigned} unsigned` +
    `${signing.rejects_unsigned ? ' (refused)' : ' (taken)'}, ${signing.wrong_key} with another key, ` +
    `${signing.repeated} repeated, ${signing.past} of a clock in the past.`;
  const oddities = [
    ...(refused > 0 ? [`${refused} refused`] : []),
    ...(!signing.rejects_unsigned && signing.unsigned > 0 ? [`${signing.unsigned} unsigned taken`] : []),
  ];
  const words = [
    signing.good > 0 ? 'signed' : 'no signed packet yet',
    ...(signing.rotated_at ? [`key rotated ${timeOfDay(signing.rotated_at)}`] : []),
    ...oddities,
  ];
  const look = signing.problem ? 'bad' : signing.good === 0 || oddities.length > 0 ? 'warn' : 'good';
  return { text: words.join(' · '), look, detail };
}
