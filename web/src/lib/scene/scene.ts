import {
  AmbientLight,
  Box3,
  Color,
  DirectionalLight,
  PerspectiveCamera,
  Scene,
  Vector2,
  Vector3,
  WebGLRenderer,
} from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';

import { palette } from './palette';
import type { Layer } from './layer';

const FIRST_LOOK = new Vector3(-0.62, -0.68, 0.42);
const PIXEL_RATIO_LIMIT = 2;
/** How much of the view a fitted box fills; the rest is for names. */
const FILLED_SHARE = 0.88;

/** The 3D view: camera, light and orbit controls. It draws when something changed and rests otherwise. */
export class SceneView {
  readonly camera = new PerspectiveCamera(45, 1, 0.1, 5000);
  /** Called before each drawn frame, for things that keep their size on the screen. */
  beforeDraw: (() => void) | null = null;

  private readonly scene = new Scene();
  private readonly renderer: WebGLRenderer;
  private readonly controls: OrbitControls;
  private readonly observer: ResizeObserver;
  private frameRequest: number | null = null;
  private frames = 0;

  /**
   * @param canvas where to draw; its `data-frames` attribute counts the drawn frames.
   * @throws Error when the browser has no WebGL.
   */
  constructor(private readonly canvas: HTMLCanvasElement) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true });
    this.scene.background = new Color(palette.background);
    this.camera.up.set(0, 0, 1);
    this.camera.position.copy(FIRST_LOOK).multiplyScalar(100);
    this.scene.add(new AmbientLight('#ffffff', 1.1));
    const sun = new DirectionalLight('#ffffff', 2.2);
    sun.position.set(-0.5, -0.9, 1.4);
    const fill = new DirectionalLight('#9fc3ff', 0.7);
    fill.position.set(0.8, 0.6, 0.2);
    this.scene.add(sun, fill);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = true;
    this.controls.dampingFactor = 0.12;
    this.controls.addEventListener('change', () => this.requestDraw());
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(canvas.parentElement ?? canvas);
    this.resize();
  }

  add(layer: Layer): void {
    this.scene.add(layer.group);
  }

  /** Ask for one frame soon; any number of calls before it make one frame. */
  requestDraw(): void {
    this.frameRequest ??= requestAnimationFrame(() => this.draw());
  }

  /** Look at everything inside a box, from the first direction. */
  fit(low: readonly number[], high: readonly number[]): void {
    const box = new Box3(new Vector3(low[0], low[1], low[2]), new Vector3(high[0], high[1], high[2]));
    const center = box.getCenter(new Vector3());
    const backward = FIRST_LOOK.clone().normalize();
    const right = new Vector3(0, 0, 1).cross(backward).normalize();
    const up = backward.clone().cross(right);
    const tangentY = Math.tan((this.camera.fov * Math.PI) / 360) * FILLED_SHARE;
    const tangentX = tangentY * this.camera.aspect;
    let distance = 1;
    for (let corner = 0; corner < 8; corner += 1) {
      const at = (bit: number, axis: 'x' | 'y' | 'z') => (corner & bit ? box.max[axis] : box.min[axis]);
      const offset = new Vector3(at(1, 'x'), at(2, 'y'), at(4, 'z')).sub(center);
      const across = Math.max(Math.abs(offset.dot(right)) / tangentX, Math.abs(offset.dot(up)) / tangentY);
      distance = Math.max(distance, across + offset.dot(backward));
    }
    this.controls.target.copy(center);
    this.camera.position.copy(center).addScaledVector(backward, distance);
    this.camera.near = Math.max(0.05, distance / 2000);
    this.camera.far = distance * 20;
    this.camera.updateProjectionMatrix();
    this.controls.update();
    this.requestDraw();
  }

  /** Where a point is on the canvas, in CSS pixels; null behind the camera. */
  project(point: Vector3): Vector2 | null {
    const p = point.clone().project(this.camera);
    if (p.z > 1) return null;
    return new Vector2(((p.x + 1) / 2) * this.canvas.clientWidth, ((1 - p.y) / 2) * this.canvas.clientHeight);
  }

  dispose(): void {
    if (this.frameRequest !== null) cancelAnimationFrame(this.frameRequest);
    this.frameRequest = -1;
    this.observer.disconnect();
    this.controls.dispose();
    this.renderer.dispose();
  }

  private draw(): void {
    this.frameRequest = null;
    this.controls.update();
    this.beforeDraw?.();
    this.renderer.render(this.scene, this.camera);
    this.frames += 1;
    this.canvas.dataset['frames'] = String(this.frames);
  }

  private resize(): void {
    const parent = this.canvas.parentElement;
    const width = Math.max(1, parent?.clientWidth ?? 1);
    const height = Math.max(1, parent?.clientHeight ?? 1);
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, PIXEL_RATIO_LIMIT));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.requestDraw();
  }
}
