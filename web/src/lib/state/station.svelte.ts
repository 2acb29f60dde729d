import { call, describe, get, post } from '../api/client';
import { LiveStream } from '../api/live';
import type {
  FlightEvent,
  FlightInfo,
  ImageInfo,
  LinkInfo,
  LiveMessage,
  OnVehicle,
  PlanAccepted,
  PlanOfferInfo,
  ReplanInfo,
  Track,
} from '../api/types';
import {
  NOTHING_KNOWN,
  applyLive,
  eventLine,
  withFlight,
  withLink,
  withLog,
  withPlan,
  withRecords,
  type StationState,
} from './station_state';

/** The stream's state: `connecting` until the first snapshot, `live`, or `lost`. */
export type Connection = 'connecting' | 'live' | 'lost';

const CLOCK_TICK_MS = 250;

/** What the station tells, kept live; the only place that talks to it for reading. */
export class Station {
  state: StationState = $state.raw(NOTHING_KNOWN);
  connection: Connection = $state('connecting');
  /** Wall-clock time of losing the stream; null while live. */
  lostAt: Date | null = $state.raw(null);
  /** ms of the page's monotonic clock of the next try; null while live. */
  retryAtMs: number | null = $state(null);
  /** ms of the page's monotonic clock, ticking, so that ages grow on the screen. */
  nowMs = $state(performance.now());

  private readonly stream = new LiveStream({
    message: (message) => this.take(message),
    lost: (retryInMs) => this.lose(retryInMs),
  });
  private noticeNumber = 0;
  private followed: string | null = null;

  get live(): boolean {
    return this.connection === 'live';
  }

  /** Connect and keep connected; returns what ends it. */
  start(): () => void {
    const ticker = setInterval(() => (this.nowMs = performance.now()), CLOCK_TICK_MS);
    const retry = () => this.stream.retryNow();
    window.addEventListener('online', retry);
    this.stream.start();
    return () => {
      clearInterval(ticker);
      window.removeEventListener('online', retry);
      this.stream.stop();
    };
  }

  retryNow(): void {
    this.stream.retryNow();
  }

  /** Load everything that was recorded of a flight, and again after each break of the stream. */
  async follow(flightId: string | null): Promise<void> {
    this.followed = flightId;
    if (flightId === null) return;
    try {
      const [track, events, images, replans, offers, onVehicle] = await Promise.all([
        get<Track>(`/flights/${flightId}/track`),
        get<FlightEvent[]>(`/flights/${flightId}/events`),
        get<ImageInfo[]>(`/flights/${flightId}/images`),
        get<ReplanInfo[]>(`/flights/${flightId}/replans`),
        get<PlanOfferInfo[]>(`/flights/${flightId}/offers`),
        get<OnVehicle>(`/flights/${flightId}/on-vehicle`),
      ]);
      this.state = withRecords(this.state, flightId, { track: track.points, images, replans, offers, onVehicle });
      this.state = withLog(this.state, events.map(eventLine));
    } catch (error) {
      this.note(4, `The records of the flight could not be read: ${describe(error)}`);
    }
  }

  /** Ask again what the vehicle was last known to hold (from the station's records). */
  async refreshOnVehicle(flightId: string): Promise<void> {
    try {
      const onVehicle = await get<OnVehicle>(`/flights/${flightId}/on-vehicle`);
      this.state = withRecords(this.state, flightId, { onVehicle });
    } catch (error) {
      this.note(4, `What the vehicle holds could not be read: ${describe(error)}`);
    }
  }

  /** Have the vehicle's mission read now and compared with the plan's. */
  async readBack(flightId: string): Promise<void> {
    const onVehicle = await post<OnVehicle>(`/flights/${flightId}/read-back`);
    this.state = withRecords(this.state, flightId, { onVehicle });
  }

  async makePlan(scenario: unknown): Promise<string> {
    const { plan, job } = await post<PlanAccepted>('/plans', { scenario });
    // The live stream may have told more of the job already.
    if (!this.state.plans.some((p) => p.id === plan.id)) {
      this.state = { ...this.state, plans: withPlan(this.state.plans, { ...plan, job }) };
    }
    return plan.id;
  }

  /** Accept or refuse a plan that was offered for what was skipped. */
  async decide(offer: PlanOfferInfo, decision: 'accept' | 'refuse'): Promise<PlanOfferInfo> {
    return this.takeOffer(await post<PlanOfferInfo>(`/offers/${offer.id}/${decision}`));
  }

  /** Ask for a plan for what a flight skipped. */
  async askForOffer(flightId: string): Promise<PlanOfferInfo> {
    return this.takeOffer(await post<PlanOfferInfo>(`/flights/${flightId}/offers`));
  }

  async openLink(url: string): Promise<void> {
    const link = await post<LinkInfo>('/links', { url });
    this.state = { ...this.state, links: withLink(this.state.links, link) };
  }

  async closeLink(id: string): Promise<void> {
    await call('DELETE', `/links/${id}`);
    this.state = { ...this.state, links: this.state.links.filter((link) => link.id !== id) };
  }

  /** A flight as a command's answer gave it. */
  takeFlight(flight: FlightInfo): void {
    this.state = { ...this.state, flights: withFlight(this.state.flights, flight) };
  }

  /** Put a line of the dashboard's own into the log. */
  note(severity: number, text: string): void {
    this.noticeNumber += 1;
    const line = { key: `note ${this.noticeNumber}`, at: new Date().toISOString(), severity, source: 'dashboard', text };
    this.state = withLog(this.state, [line]);
  }

  private takeOffer(offer: PlanOfferInfo): PlanOfferInfo {
    this.state = withRecords(this.state, offer.flight_id, { offers: [offer] });
    return offer;
  }

  private take(message: LiveMessage): void {
    this.nowMs = performance.now();
    const before = this.state.flights.find((f) => f.id === this.followed);
    this.state = applyLive(this.state, message, this.nowMs);
    if (message.type === 'snapshot') {
      this.connection = 'live';
      this.lostAt = this.retryAtMs = null;
      void this.follow(this.followed);
    }
    if (message.type === 'flight' && message.flight.id === this.followed) {
      const { id, state, proved } = message.flight;
      if (before?.state !== state || before.proved !== proved) void this.refreshOnVehicle(id);
    }
  }

  private lose(retryInMs: number): void {
    this.connection = 'lost';
    this.lostAt ??= new Date();
    this.retryAtMs = performance.now() + retryInMs;
  }
}
