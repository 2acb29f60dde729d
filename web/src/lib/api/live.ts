import type { LiveMessage } from './types';

/** The station sends a heartbeat every two seconds; longer silence than this means that the stream is dead. */
export const SILENCE_LIMIT_MS = 5000;
const FIRST_WAIT_MS = 500;
const LONGEST_WAIT_MS = 5000;

export interface LiveHandlers {
  message(message: LiveMessage): void;
  /** The stream ended, or could not be opened; `retryInMs` until the next try. */
  lost(retryInMs: number): void;
}

/** What the stream needs of the browser; tests give their own. */
export interface LiveEnvironment {
  open(): WebSocket;
  /** Renews the session cookie, which a restarted station asks for. */
  renewSession(): Promise<unknown>;
  random(): number;
}

const browser: LiveEnvironment = {
  open: () => new WebSocket(`${location.protocol === 'https:' ? 'wss' : 'ws'}://${location.host}/api/live`),
  renewSession: () => fetch('/', { cache: 'no-store' }),
  random: Math.random,
};

/** The wait before try number `attempt` (from 0): doubling, bounded, and spread so that clients do not return at once. */
export function backoffMs(attempt: number, random: number): number {
  return Math.min(LONGEST_WAIT_MS, FIRST_WAIT_MS * 2 ** attempt) * (0.75 + 0.25 * random);
}

/** The live stream, opened again for as long as it is wanted. It reads only: reconnecting never commands anything. */
export class LiveStream {
  private socket: WebSocket | null = null;
  private attempt = 0;
  private timer: ReturnType<typeof setTimeout> | null = null;
  private wanted = false;

  constructor(
    private readonly handlers: LiveHandlers,
    private readonly environment: LiveEnvironment = browser,
  ) {}

  start(): void {
    this.wanted = true;
    this.connect();
  }

  stop(): void {
    this.wanted = false;
    this.drop();
  }

  /** Try at once instead of at the end of the wait (the operator asked, or the network came back). */
  retryNow(): void {
    if (!this.wanted || this.socket !== null) return;
    this.attempt = 0;
    void this.reconnect();
  }

  private connect(): void {
    this.drop();
    const socket = this.environment.open();
    this.socket = socket;
    this.after(SILENCE_LIMIT_MS, () => this.lose());
    socket.onmessage = (event: MessageEvent<string>) => {
      this.attempt = 0;
      this.after(SILENCE_LIMIT_MS, () => this.lose());
      this.handlers.message(JSON.parse(event.data) as LiveMessage);
    };
    socket.onclose = () => this.lose();
  }

  private lose(): void {
    this.drop();
    if (!this.wanted) return;
    const wait = backoffMs(this.attempt, this.environment.random());
    this.attempt += 1;
    this.handlers.lost(wait);
    this.after(wait, () => void this.reconnect());
  }

  private async reconnect(): Promise<void> {
    this.clearTimer();
    try {
      await this.environment.renewSession();
    } catch {
      // The station is still away: opening the stream fails as well and waits longer.
    }
    if (this.wanted && this.socket === null) this.connect();
  }

  private drop(): void {
    this.clearTimer();
    const socket = this.socket;
    this.socket = null;
    if (!socket) return;
    socket.onmessage = socket.onclose = null;
    socket.close();
  }

  private after(ms: number, act: () => void): void {
    this.clearTimer();
    this.timer = setTimeout(act, ms);
  }

  private clearTimer(): void {
    if (this.timer !== null) clearTimeout(this.timer);
    this.timer = null;
  }
}
