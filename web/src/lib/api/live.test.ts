import { afterEach, beforeEach, describe, expect, it, vi } from 'vitest';

import { LiveStream, SILENCE_LIMIT_MS, backoffMs } from './live';

class FakeSocket {
  onmessage: ((event: { data: string }) => void) | null = null;
  onclose: (() => void) | null = null;
  closed = false;

  close(): void {
    this.closed = true;
  }

  tell(): void {
    this.onmessage?.({ data: JSON.stringify({ type: 'heartbeat', at: '' }) });
  }
}

function streamWithFakes() {
  const sockets: FakeSocket[] = [];
  const lost: number[] = [];
  const heard: string[] = [];
  const renewSession = vi.fn(() => Promise.resolve());
  const stream = new LiveStream(
    { message: (m) => heard.push(m.type), lost: (ms) => lost.push(ms) },
    {
      open: () => {
        const socket = new FakeSocket();
        sockets.push(socket);
        return socket as unknown as WebSocket;
      },
      renewSession,
      random: () => 1,
    },
  );
  stream.start();
  return { stream, sockets, lost, heard, renewSession };
}

describe('live stream', () => {
  beforeEach(() => void vi.useFakeTimers());
  afterEach(() => void vi.useRealTimers());

  it('says at once that it was closed and comes back after the wait', async () => {
    const { sockets, lost, renewSession } = streamWithFakes();
    sockets[0]?.tell();
    sockets[0]?.onclose?.();
    expect(lost).toEqual([500]);
    await vi.advanceTimersByTimeAsync(499);
    expect(sockets).toHaveLength(1);
    await vi.advanceTimersByTimeAsync(1);
    expect(renewSession).toHaveBeenCalledOnce();
    expect(sockets).toHaveLength(2);
  });

  it('takes silence for a loss, and any message for life', async () => {
    const { sockets, lost } = streamWithFakes();
    await vi.advanceTimersByTimeAsync(SILENCE_LIMIT_MS - 1);
    sockets[0]?.tell();
    await vi.advanceTimersByTimeAsync(SILENCE_LIMIT_MS - 1);
    expect(lost).toEqual([]);
    await vi.advanceTimersByTimeAsync(1);
    expect(lost).toHaveLength(1);
    expect(sockets[0]?.closed).toBe(true);
  });

  it('waits longer each time, and short again after a success', async () => {
    const { sockets, lost } = streamWithFakes();
    for (let i = 0; i < 3; i += 1) {
      sockets.at(-1)?.onclose?.();
      await vi.advanceTimersByTimeAsync(lost.at(-1) ?? 0);
    }
    expect(lost).toEqual([500, 1000, 2000]);
    sockets.at(-1)?.tell();
    sockets.at(-1)?.onclose?.();
    expect(lost.at(-1)).toBe(500);
  });

  it('comes back although the session cannot be renewed', async () => {
    const { sockets, renewSession } = streamWithFakes();
    renewSession.mockRejectedValue(new Error('away'));
    sockets[0]?.onclose?.();
    await vi.advanceTimersByTimeAsync(500);
    expect(sockets).toHaveLength(2);
  });

  it('opens one socket only when asked twice', async () => {
    const { stream, sockets } = streamWithFakes();
    sockets[0]?.onclose?.();
    stream.retryNow();
    stream.retryNow();
    await vi.advanceTimersByTimeAsync(10_000 - SILENCE_LIMIT_MS - 1);
    expect(sockets).toHaveLength(2);
  });

  it('stays closed when it was stopped', async () => {
    const { stream, sockets } = streamWithFakes();
    sockets[0]?.onclose?.();
    stream.stop();
    await vi.advanceTimersByTimeAsync(60_000);
    expect(sockets).toHaveLength(1);
  });

  it('bounds and spreads the wait', () => {
    expect(backoffMs(0, 0)).toBe(375);
    expect(backoffMs(20, 1)).toBe(5000);
    expect(backoffMs(20, 0)).toBe(3750);
  });
});
