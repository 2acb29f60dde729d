import { describe, expect, it } from 'vitest';

import { parsePly } from './ply';

const HEADER = (vertexType: string, faces = 1) =>
  `ply\nformat binary_little_endian 1.0\ncomment x\nelement vertex 3\nproperty ${vertexType} x\nproperty ${vertexType} y\n` +
  `property ${vertexType} z\nproperty uchar red\nelement face ${faces}\nproperty list uchar int vertex_indices\nend_header\n`;

function file(vertexType: 'float' | 'double', corners = 3): ArrayBuffer {
  const header = new TextEncoder().encode(HEADER(vertexType));
  const wide = vertexType === 'double' ? 8 : 4;
  const body = new DataView(new ArrayBuffer(3 * (3 * wide + 1) + 1 + 4 * corners));
  let offset = 0;
  for (let i = 0; i < 9; i += 1) {
    if (vertexType === 'double') body.setFloat64(offset, i + 0.5, true);
    else body.setFloat32(offset, i + 0.5, true);
    offset += wide + (i % 3 === 2 ? 1 : 0);
  }
  body.setUint8(offset, corners);
  for (let k = 0; k < corners; k += 1) body.setInt32(offset + 1 + 4 * k, 2 - k, true);
  const all = new Uint8Array(header.length + body.byteLength);
  all.set(header);
  all.set(new Uint8Array(body.buffer), header.length);
  return all.buffer;
}

describe('PLY', () => {
  it.each(['float', 'double'] as const)('reads %s vertices, skips other properties, keeps the faces', (type) => {
    const mesh = parsePly(file(type));
    expect([...mesh.positions]).toEqual([0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5, 8.5]);
    expect([...mesh.indices]).toEqual([2, 1, 0]);
  });

  it('refuses faces that are not triangles', () => {
    expect(() => parsePly(file('float', 4))).toThrow('not a triangle');
  });

  it.each([
    ['solid cube', 'not PLY'],
    ['ply\nformat ascii 1.0\nend_header\n', 'not binary little-endian'],
    [HEADER('half').replace('end_header\n', 'end_header\n\0\0'), 'unknown PLY type half'],
  ])('refuses %j', (text, reason) => {
    expect(() => parsePly(new TextEncoder().encode(text).buffer)).toThrow(reason);
  });

  it('refuses a file that ends early', () => {
    expect(() => parsePly(file('float').slice(0, -3))).toThrow(RangeError);
  });
});
