import { BufferAttribute, BufferGeometry, Line, LineDashedMaterial, type Object3D } from 'three';
import { Line2 } from 'three/addons/lines/Line2.js';
import { LineGeometry } from 'three/addons/lines/LineGeometry.js';
import { LineMaterial } from 'three/addons/lines/LineMaterial.js';

export type Point3 = readonly number[];

/** A polyline of a width in pixels, or nothing for fewer than two points. */
export function thickLine(points: readonly Point3[], color: string, widthPx: number, opacity = 1): Object3D | null {
  if (points.length < 2) return null;
  const geometry = new LineGeometry();
  geometry.setPositions(points.flatMap((p) => [p[0] ?? 0, p[1] ?? 0, p[2] ?? 0]));
  const material = new LineMaterial({ color, linewidth: widthPx, transparent: opacity < 1, opacity });
  return new Line2(geometry, material);
}

/** A hair line of dashes, or nothing for fewer than two points. */
export function dashedLine(points: readonly Point3[], color: string, dashM: number): Object3D | null {
  if (points.length < 2) return null;
  const geometry = new BufferGeometry();
  geometry.setAttribute('position', new BufferAttribute(new Float32Array(points.flatMap((p) => [...p])), 3));
  const line = new Line(geometry, new LineDashedMaterial({ color, dashSize: dashM, gapSize: dashM * 0.7 }));
  line.computeLineDistances();
  return line;
}
