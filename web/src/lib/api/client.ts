import type { Problem, StructureDetail } from './types';

/** The station (or the way to it) said no; the message is meant for the operator. */
export class ApiError extends Error {
  constructor(
    message: string,
    readonly status: number,
    readonly title: string,
  ) {
    super(message);
  }
}

/** One sentence for the operator, whatever was thrown. */
export function describe(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}

/**
 * Call the station.
 *
 * @param path below `/api`.
 * @throws ApiError when it does not answer or refuses.
 */
export async function call(method: string, path: string, body?: unknown): Promise<Response> {
  return send(method, path, body === undefined ? undefined : JSON.stringify(body), 'application/json');
}

export async function get<T>(path: string): Promise<T> {
  return (await call('GET', path)).json() as Promise<T>;
}

export async function post<T>(path: string, body: unknown = {}): Promise<T> {
  return (await call('POST', path, body)).json() as Promise<T>;
}

async function send(method: string, path: string, body?: BodyInit, contentType?: string): Promise<Response> {
  const headers = new Headers(body !== undefined && contentType ? { 'Content-Type': contentType } : {});
  let response: Response;
  try {
    response = await fetch(`/api${path}`, { method, body, headers, credentials: 'same-origin', cache: 'no-store' });
  } catch {
    throw new ApiError('The station does not answer: is it running?', 0, 'No station');
  }
  if (!response.ok) throw await refusal(response);
  return response;
}

async function refusal(response: Response): Promise<ApiError> {
  if (response.headers.get('Content-Type')?.includes('json')) {
    const problem = (await response.json()) as Partial<Problem>;
    const detail = problem.detail ?? response.statusText;
    const text = problem.field && !detail.includes(problem.field) ? `${problem.field}: ${detail}` : detail;
    return new ApiError(text, response.status, problem.title ?? 'Refused');
  }
  return new ApiError(`The station answered ${response.status} ${response.statusText}`, response.status, 'Refused');
}

/** Bring a mesh in as it is: metres, z up, at the scene's origin. */
export async function addMesh(file: File): Promise<StructureDetail> {
  const form = new FormData();
  form.set('file', file);
  return (await send('POST', '/structures', form)).json() as Promise<StructureDetail>;
}
