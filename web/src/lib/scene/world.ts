import type { Vector2, Vector3 } from 'three';

import type { OnVehicle, PlanDetail, ReplanInfo, TrackSample } from '../api/types';
import { CoverageLayer, type SampleState } from './coverage_layer';
import { DetourLayer, FlownLayer, OnVehicleLayer } from './flight_layers';
import { COMMON_VIEW, type FieldOfView } from './frustum';
import { HomeLayer, PathLayer, TrajectoryLayer, ViewpointLayer, type DrawnViewpoint } from './plan_layer';
import { SceneView } from './scene';
import { GroundLayer, StructureLayer, type TriangleMesh } from './structure_layer';
import { VehicleLayer, type VehiclePose } from './vehicle_layer';

const LAYERS = {
  ground: () => new GroundLayer(),
  structure: () => new StructureLayer(),
  coverage: () => new CoverageLayer(),
  viewpoints: () => new ViewpointLayer(),
  path: () => new PathLayer(),
  trajectory: () => new TrajectoryLayer(),
  onVehicle: () => new OnVehicleLayer(),
  flown: () => new FlownLayer(),
  detours: () => new DetourLayer(),
  home: () => new HomeLayer(),
  vehicle: () => new VehicleLayer(),
};

export type LayerName = keyof typeof LAYERS;

/** All layers of the 3D view; every `show...` replaces what that layer drew before and asks for a frame. */
export class World {
  private readonly view: SceneView;
  private readonly layers: { [Name in LayerName]: ReturnType<(typeof LAYERS)[Name]> };
  private fieldOfView: FieldOfView = COMMON_VIEW;
  private bounds: { low: number[]; high: number[] } | null = null;

  /** @throws Error when the browser has no WebGL. */
  constructor(canvas: HTMLCanvasElement) {
    this.view = new SceneView(canvas);
    this.layers = Object.fromEntries(
      Object.entries(LAYERS).map(([name, make]) => [name, make()]),
    ) as typeof this.layers;
    for (const layer of Object.values(this.layers)) this.view.add(layer);
    this.view.beforeDraw = () => this.layers.vehicle.keepSize(this.view.camera);
  }

  setVisible(name: LayerName, visible: boolean): void {
    this.layers[name].visible = visible;
    this.view.requestDraw();
  }

  showPlan(plan: PlanDetail | null, mesh: TriangleMesh | null, fieldOfView: FieldOfView): void {
    this.fieldOfView = fieldOfView;
    this.layers.structure.clear();
    this.layers.ground.clear();
    if (plan && mesh) {
      this.layers.structure.show(mesh, plan.cables);
      const { low, high } = boundsOf(plan, mesh);
      this.layers.ground.show(low, high, plan.ground_m ?? plan.home_m[2]);
      this.bounds = { low, high };
    }
    this.showCoverage(plan);
    this.layers.viewpoints.show(plan?.viewpoints ?? [], fieldOfView);
    this.layers.path.show(plan?.path_m ?? []);
    this.layers.trajectory.show(plan?.trajectory.position_m ?? []);
    this.layers.home.show(plan?.home_m ?? null);
    this.fit();
  }

  markViewpoints(photographed: ReadonlySet<number>, skipped: ReadonlySet<number>, selected: number | null): void {
    this.layers.viewpoints.mark(photographed, skipped, selected);
    this.view.requestDraw();
  }

  showOnVehicle(onVehicle: OnVehicle | null): void {
    const places = (onVehicle?.items ?? []).flatMap((item) => (item.position_m ? [item.position_m] : []));
    this.layers.onVehicle.show(onVehicle?.read_at ? places : []);
    this.view.requestDraw();
  }

  showFlown(track: readonly TrackSample[]): void {
    this.layers.flown.show(track.map((sample) => sample.position_m));
    this.view.requestDraw();
  }

  showDetours(replans: readonly ReplanInfo[]): void {
    this.layers.detours.show(replans);
    this.view.requestDraw();
  }

  showVehicle(name: string, pose: VehiclePose | null): void {
    this.layers.vehicle.show(name, pose, this.fieldOfView);
    this.view.requestDraw();
  }

  /** Look at the whole plan. */
  fit(): void {
    if (this.bounds) this.view.fit(this.bounds.low, this.bounds.high);
  }

  /** The viewpoint under a spot of the canvas (CSS pixels). */
  viewpointAt(xPx: number, yPx: number): DrawnViewpoint | null {
    if (!this.layers.viewpoints.visible) return null;
    return this.layers.viewpoints.nearest((p: Vector3): Vector2 | null => this.view.project(p), xPx, yPx);
  }

  dispose(): void {
    for (const layer of Object.values(this.layers)) layer.clear();
    this.view.dispose();
  }

  private showCoverage(plan: PlanDetail | null): void {
    const coverage = plan?.coverage;
    if (!coverage) {
      this.layers.coverage.clear();
      return;
    }
    const states = coverage.seen.map(
      (seen, i): SampleState => (seen ? 'seen' : coverage.coverable[i] ? 'unseen' : 'notCoverable'),
    );
    this.layers.coverage.show(
      new Float32Array(coverage.points_m.flat()),
      new Float32Array(coverage.normals.flat()),
      states,
    );
  }
}

function boundsOf(plan: PlanDetail, mesh: TriangleMesh): { low: number[]; high: number[] } {
  const low = [...plan.home_m] as number[];
  const high = [...plan.home_m] as number[];
  const include = (value: number, axis: number) => {
    low[axis] = Math.min(low[axis] ?? value, value);
    high[axis] = Math.max(high[axis] ?? value, value);
  };
  mesh.positions.forEach((value, i) => include(value, i % 3));
  for (const point of plan.trajectory.position_m) point.forEach(include);
  for (const cable of plan.cables) for (const end of [cable.from_m, cable.to_m]) end.forEach(include);
  return { low, high };
}
