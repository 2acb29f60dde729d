/** Lists that are kept up to date by a live stream and filled up over REST: nothing twice, order kept. */

/** The list with `item` in the place of the one with the same key, or added. */
export function upsert<T>(list: readonly T[], item: T, key: (t: T) => unknown): T[] {
  const index = list.findIndex((other) => key(other) === key(item));
  return index < 0 ? [...list, item] : list.with(index, item);
}

/** Both lists without doubles, in the order of `order`; of two with the same key the one of `newer` stays. */
export function union<T>(
  older: readonly T[],
  newer: readonly T[],
  key: (t: T) => string | number,
  order: (a: T, b: T) => number,
): T[] {
  const byKey = new Map(older.map((item) => [key(item), item]));
  for (const item of newer) byKey.set(key(item), item);
  return [...byKey.values()].sort(order);
}

/** Ascending by a text or number. */
export function ascending<T>(of: (t: T) => string | number): (a: T, b: T) => number {
  return (a, b) => {
    const [x, y] = [of(a), of(b)];
    return x < y ? -1 : x > y ? 1 : 0;
  };
}

/** Descending by a text or number. */
export function descending<T>(of: (t: T) => string | number): (a: T, b: T) => number {
  const up = ascending(of);
  return (a, b) => up(b, a);
}
