import type { TriangleMesh } from '../scene/structure_layer';

const SIZES: Record<string, number> = {
  char: 1, uchar: 1, int8: 1, uint8: 1,
  short: 2, ushort: 2, int16: 2, uint16: 2,
  int: 4, uint: 4, int32: 4, uint32: 4, float: 4, float32: 4,
  double: 8, float64: 8,
};
const END = 'end_header\n';

interface Property {
  name: string;
  type: string;
  /** Type of the length, for lists. */
  countType: string | null;
}

interface Element {
  name: string;
  count: number;
  properties: Property[];
}

/**
 * Read a binary little-endian PLY file: vertices with x, y, z and faces that are triangles.
 *
 * @throws Error that says what is wrong with the file.
 */
export function parsePly(data: ArrayBuffer): TriangleMesh {
  const head = new TextDecoder('latin1').decode(data.slice(0, 4096));
  const end = head.indexOf(END);
  if (!head.startsWith('ply') || end < 0) throw new Error('the structure file is not PLY');
  if (!head.includes('format binary_little_endian')) throw new Error('the structure file is not binary little-endian PLY');
  const view = new DataView(data);
  let offset = end + END.length;
  let positions = new Float32Array();
  let indices = new Uint32Array();
  for (const element of parseHeader(head.slice(0, end))) {
    if (element.name === 'vertex') positions = new Float32Array(3 * element.count);
    if (element.name === 'face') indices = new Uint32Array(3 * element.count);
    for (let row = 0; row < element.count; row += 1) {
      for (const { name, type, countType } of element.properties) {
        const count = countType ? read(view, offset, countType) : 1;
        if (countType) offset += size(countType);
        if (element.name === 'face' && countType && count !== 3) throw new Error('a face is not a triangle');
        const axis = 'xyz'.indexOf(name);
        for (let k = 0; k < count; k += 1) {
          if (element.name === 'vertex' && axis >= 0) positions[3 * row + axis] = read(view, offset, type);
          if (element.name === 'face' && countType) indices[3 * row + k] = read(view, offset, type);
          offset += size(type);
        }
      }
    }
  }
  return { positions, indices };
}

function parseHeader(text: string): Element[] {
  const elements: Element[] = [];
  for (const line of text.split('\n')) {
    const words = line.trim().split(/\s+/);
    if (words[0] === 'element') elements.push({ name: words[1] ?? '', count: Number(words[2]), properties: [] });
    if (words[0] !== 'property') continue;
    const list = words[1] === 'list';
    const [countType, type, name] = list ? [words[2] ?? '', words[3] ?? '', words[4] ?? ''] : [null, words[1] ?? '', words[2] ?? ''];
    for (const known of countType === null ? [type] : [countType, type]) size(known);
    elements.at(-1)?.properties.push({ name, type, countType });
  }
  return elements;
}

function size(type: string): number {
  const bytes = SIZES[type];
  if (bytes === undefined) throw new Error(`unknown PLY type ${type}`);
  return bytes;
}

function read(view: DataView, offset: number, type: string): number {
  switch (type) {
    case 'char': case 'int8': return view.getInt8(offset);
    case 'uchar': case 'uint8': return view.getUint8(offset);
    case 'short': case 'int16': return view.getInt16(offset, true);
    case 'ushort': case 'uint16': return view.getUint16(offset, true);
    case 'int': case 'int32': return view.getInt32(offset, true);
    case 'uint': case 'uint32': return view.getUint32(offset, true);
    case 'float': case 'float32': return view.getFloat32(offset, true);
    default: return view.getFloat64(offset, true);
  }
}
