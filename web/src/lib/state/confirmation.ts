/** How long "land" and "return" must be held down. */
export const HOLD_MS = 800;

/** Whether what was typed names the vehicle; letters' case and blanks around it do not matter. */
export function namesVehicle(typed: string, vehicleName: string): boolean {
  return typed.trim().toLowerCase() === vehicleName.toLowerCase();
}

export interface AcceptanceQuestion {
  /** Name of the failsafe, as the station wants to hear it. */
  name: string;
  detail: string;
}

/** Whether an action may be sent: the vehicle is named and every switched-off failsafe is accepted by its name. */
export function mayProceed(
  typed: string,
  vehicleName: string,
  questions: readonly AcceptanceQuestion[],
  accepted: ReadonlySet<string>,
): boolean {
  return namesVehicle(typed, vehicleName) && questions.every((q) => accepted.has(q.name));
}

/**
 * A button that must be held down: it fires once after `HOLD_MS`, and not at all when let go earlier.
 * Time is given from outside.
 */
export class HoldToConfirm {
  private startedMs: number | null = null;
  private fired = false;

  press(nowMs: number): void {
    this.startedMs = nowMs;
    this.fired = false;
  }

  release(): void {
    this.startedMs = null;
  }

  /** Share of the time it has been held, 0 to 1. */
  fraction(nowMs: number): number {
    return this.startedMs === null ? 0 : Math.min(1, (nowMs - this.startedMs) / HOLD_MS);
  }

  /** True exactly once, when it has been held long enough. */
  due(nowMs: number): boolean {
    if (this.fired || this.fraction(nowMs) < 1) return false;
    this.fired = true;
    return true;
  }
}
