import { Group, type BufferGeometry, type Material, type Object3D } from 'three';

/** A named part of the scene that can be shown or hidden as a whole. Positions are scene ENU metres, z up. */
export class Layer {
  readonly group = new Group();

  constructor(name: string) {
    this.group.name = name;
  }

  get visible(): boolean {
    return this.group.visible;
  }

  set visible(shown: boolean) {
    this.group.visible = shown;
  }

  /** Remove everything and give the graphics memory back. */
  clear(): void {
    for (const child of [...this.group.children]) {
      this.group.remove(child);
      release(child);
    }
  }
}

/** Free the geometries, materials and textures below an object. */
export function release(object: Object3D): void {
  object.traverse((node) => {
    const part = node as { geometry?: BufferGeometry; material?: (Material & { map?: { dispose(): void } | null }) };
    part.geometry?.dispose();
    part.material?.map?.dispose();
    part.material?.dispose();
  });
}
