import { describe, get, post } from '../api/client';
import type { FlightInfo, PreflightInfo } from '../api/types';
import type { AcceptanceQuestion } from './confirmation';
import type { Station } from './station.svelte';

export type FlightMode = FlightInfo['mode'];
/** What an operator asks of a flight; `start` and `resume` need the vehicle's name. */
export type Command = 'upload' | 'cancel-transfer' | 'start' | 'resume' | 'pause' | 'return' | 'land';

/** Commands to a flight, one at a time except for those that make it safer, and what came of them. */
export class FlightActions {
  /** What is under way; null when nothing is. */
  busy: Command | 'prepare' | 'check' | 'read back' | null = $state(null);
  problem: string | null = $state(null);
  preflight: PreflightInfo | null = $state.raw(null);
  /** Names of switched-off failsafes that the operator accepted for this flight. */
  accepted: ReadonlySet<string> = $state.raw(new Set<string>());

  /** Failsafes that are off and must be accepted by name. */
  readonly questions: AcceptanceQuestion[] = $derived.by(() =>
    (this.preflight?.checks ?? []).flatMap((check) =>
      check.accept !== null && (check.state === 'needs_acceptance' || check.state === 'accepted')
        ? [{ name: check.accept, detail: check.detail }]
        : [],
    ),
  );

  private flightId: string | null = null;

  constructor(private readonly station: Station) {}

  /** Turn to another flight: its checks and acceptances are its own. */
  turnTo(flight: FlightInfo | null): void {
    if (flight?.id === this.flightId) return;
    this.flightId = flight?.id ?? null;
    this.preflight = null;
    this.problem = null;
    this.accepted = new Set(flight?.accepted_failsafes ?? []);
  }

  accept(name: string, yes: boolean): void {
    const accepted = new Set(this.accepted);
    if (yes) accepted.add(name);
    else accepted.delete(name);
    this.accepted = accepted;
  }

  /** Make the flight in the station's records and check the vehicle; nothing is commanded. */
  async prepare(planId: string, vehicle: string, mode: FlightMode | undefined): Promise<void> {
    await this.run('prepare', async () => {
      const flight = await post<FlightInfo>('/flights', { plan_id: planId, vehicle, mode });
      this.station.takeFlight(flight);
      this.turnTo(flight);
      this.preflight = await get<PreflightInfo>(`/flights/${flight.id}/preflight`);
    });
  }

  async check(flight: FlightInfo): Promise<void> {
    await this.run('check', async () => {
      const report = await get<PreflightInfo>(`/flights/${flight.id}/preflight`);
      if (this.flightId === flight.id) this.preflight = report;
    });
  }

  async readBack(flight: FlightInfo): Promise<void> {
    await this.run('read back', () => this.station.readBack(flight.id));
  }

  /** @param confirm the vehicle's name as the operator gave it; null for commands that need none. */
  async send(command: Command, flight: FlightInfo, confirm: string | null): Promise<boolean> {
    const needsChecks = command === 'upload' || command === 'start' || command === 'resume';
    const body = needsChecks ? { confirm, accept: [...this.accepted] } : { confirm };
    return this.run(command, async () => {
      this.station.takeFlight(await post<FlightInfo>(`/flights/${flight.id}/${command}`, body));
    });
  }

  private async run(what: NonNullable<typeof this.busy>, act: () => Promise<void>): Promise<boolean> {
    this.busy = what;
    this.problem = null;
    try {
      await act();
      return true;
    } catch (error) {
      this.problem = describe(error);
      this.station.note(3, `${what}: ${this.problem}`);
      return false;
    } finally {
      if (this.busy === what) this.busy = null;
    }
  }
}
