import { BufferAttribute, BufferGeometry, Color, Points, PointsMaterial } from 'three';

import { Layer } from './layer';
import { palette } from './palette';

/** What a sampled surface side is: seen by the plan, could be seen but is not, or cannot be seen safely. */
export type SampleState = 'seen' | 'unseen' | 'notCoverable';

const OFFSET_M = 0.06;
const DOT_M = 0.3;

/** The sampled sides of the surface, coloured by how the plan sees them. */
export class CoverageLayer extends Layer {
  constructor() {
    super('coverage');
  }

  /**
   * @param positions x, y, z of every sample.
   * @param normals the sample's side, unit; the dot is drawn a little off the surface on that side.
   * @param states one a sample.
   */
  show(positions: Float32Array, normals: Float32Array, states: readonly SampleState[]): void {
    this.clear();
    if (states.length === 0) return;
    const placed = new Float32Array(positions.length);
    for (let i = 0; i < positions.length; i += 1) placed[i] = (positions[i] ?? 0) + OFFSET_M * (normals[i] ?? 0);
    const colors = new Float32Array(positions.length);
    const ofState = {
      seen: new Color(palette.seen),
      unseen: new Color(palette.unseen),
      notCoverable: new Color(palette.notCoverable),
    };
    states.forEach((state, i) => ofState[state].toArray(colors, 3 * i));
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new BufferAttribute(placed, 3));
    geometry.setAttribute('color', new BufferAttribute(colors, 3));
    this.group.add(new Points(geometry, new PointsMaterial({ size: DOT_M, vertexColors: true })));
  }
}
