import {
  BoxGeometry,
  BufferAttribute,
  BufferGeometry,
  Color,
  ConeGeometry,
  CylinderGeometry,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshStandardMaterial,
  Vector3,
  type PerspectiveCamera,
  type Sprite,
} from 'three';

import { COMMON_VIEW, frustumSegments, type FieldOfView } from './frustum';
import { label } from './label';
import { Layer, release } from './layer';
import type { Point3 } from './lines';
import { palette } from './palette';

/** The model never looks smaller than this share of the view's height. */
const SMALLEST_ON_SCREEN = 0.035;
const VIEW_DEPTH_M = 5;

export interface VehiclePose {
  position_m: Point3;
  /** From east, counter-clockwise; null when unknown: then neither nose nor camera is drawn. */
  yaw_rad: number | null;
  /** 0 level, negative down; null when unknown. */
  gimbal_pitch_rad: number | null;
  /** Whether the position is old. */
  stale: boolean;
}

/** The vehicle as it is now: a small quadrotor with a nose, its name and what its camera looks at. */
export class VehicleLayer extends Layer {
  private readonly model = new Group();
  private readonly body = new MeshStandardMaterial({ color: palette.vehicle, roughness: 0.5 });
  private readonly nose: Mesh<ConeGeometry, MeshStandardMaterial>;
  private readonly sight: LineSegments<BufferGeometry, LineBasicMaterial>;
  private nameText = '';
  private nameLabel: Sprite | null = null;

  constructor() {
    super('vehicle');
    this.nose = new Mesh(
      new ConeGeometry(0.16, 0.5, 12).rotateZ(-Math.PI / 2).translate(0.72, 0, 0),
      new MeshStandardMaterial({ color: palette.nose }),
    );
    this.model.add(new Mesh(new BoxGeometry(0.5, 0.34, 0.16), this.body), this.nose);
    for (const angle of [1, 3, 5, 7].map((k) => (k * Math.PI) / 4)) {
      const arm = new Mesh(new BoxGeometry(0.62, 0.07, 0.06).translate(0.31, 0, 0), this.body);
      arm.rotation.z = angle;
      const disc = new Mesh(new CylinderGeometry(0.3, 0.3, 0.04, 20).rotateX(Math.PI / 2), this.body);
      disc.position.set(0.62 * Math.cos(angle), 0.62 * Math.sin(angle), 0.07);
      this.model.add(arm, disc);
    }
    const segments = new BufferGeometry();
    this.sight = new LineSegments(segments, new LineBasicMaterial({ color: palette.nose, transparent: true, opacity: 0.8 }));
    this.sight.frustumCulled = false;
    this.group.add(this.model, this.sight);
    this.model.visible = this.sight.visible = false;
  }

  /** Place the vehicle, or hide it when nothing is known of where it is. */
  show(name: string, pose: VehiclePose | null, view: FieldOfView = COMMON_VIEW): void {
    this.model.visible = pose !== null;
    this.sight.visible = pose !== null && pose.yaw_rad !== null && pose.gimbal_pitch_rad !== null;
    if (this.nameLabel) this.nameLabel.visible = pose !== null;
    if (!pose) return;
    this.rename(name);
    this.nameLabel?.position.set(pose.position_m[0] ?? 0, pose.position_m[1] ?? 0, pose.position_m[2] ?? 0);
    this.model.position.set(pose.position_m[0] ?? 0, pose.position_m[1] ?? 0, pose.position_m[2] ?? 0);
    this.model.rotation.z = pose.yaw_rad ?? 0;
    this.nose.visible = pose.yaw_rad !== null;
    this.body.color = new Color(pose.stale ? palette.stale : palette.vehicle);
    this.nose.material.color = new Color(pose.stale ? palette.stale : palette.nose);
    this.sight.material.color = this.nose.material.color;
    if (pose.yaw_rad !== null && pose.gimbal_pitch_rad !== null) {
      const points = frustumSegments(lookingFrom(pose.position_m, pose.yaw_rad, pose.gimbal_pitch_rad), view, VIEW_DEPTH_M);
      this.sight.geometry.setAttribute('position', new BufferAttribute(new Float32Array(points), 3));
    }
  }

  /** Keep the model large enough to be found from afar; called before each frame. */
  keepSize(camera: PerspectiveCamera): void {
    const distance = camera.position.distanceTo(this.model.position);
    const viewHeight = 2 * distance * Math.tan((camera.fov * Math.PI) / 360);
    this.model.scale.setScalar(Math.max(1, SMALLEST_ON_SCREEN * viewHeight));
  }

  private rename(name: string): void {
    if (name === this.nameText) return;
    this.nameText = name;
    if (this.nameLabel) {
      this.group.remove(this.nameLabel);
      release(this.nameLabel);
    }
    this.nameLabel = label(name, palette.vehicle);
    this.nameLabel.center.set(0.5, -0.9);
    this.group.add(this.nameLabel);
  }
}

function lookingFrom(position: Point3, yaw: number, pitch: number) {
  const direction = new Vector3(Math.cos(yaw) * Math.cos(pitch), Math.sin(yaw) * Math.cos(pitch), Math.sin(pitch));
  const up = new Vector3(-Math.cos(yaw) * Math.sin(pitch), -Math.sin(yaw) * Math.sin(pitch), Math.cos(pitch));
  return { position_m: position, direction: direction.toArray(), up: up.toArray() };
}
