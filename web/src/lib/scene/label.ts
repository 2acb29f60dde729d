import { CanvasTexture, Sprite, SpriteMaterial } from 'three';

const FONT_PX = 26;
const HEIGHT_PX = 36;
/** Height of a label as a share of the view's height at any distance. */
const SCREEN_HEIGHT = 0.023;

/** A short text that always faces the viewer and keeps its size on the screen. */
export function label(text: string, color: string): Sprite {
  const canvas = document.createElement('canvas');
  const context = canvas.getContext('2d');
  if (!context) throw new Error('the browser gives no 2D canvas for labels');
  const font = `600 ${FONT_PX}px system-ui, sans-serif`;
  context.font = font;
  canvas.width = Math.ceil(context.measureText(text).width) + 16;
  canvas.height = HEIGHT_PX;
  context.font = font;
  context.textBaseline = 'middle';
  context.lineWidth = 6;
  context.strokeStyle = 'rgba(8, 12, 18, 0.85)';
  context.lineJoin = 'round';
  context.strokeText(text, 8, HEIGHT_PX / 2 + 1);
  context.fillStyle = color;
  context.fillText(text, 8, HEIGHT_PX / 2 + 1);
  const material = new SpriteMaterial({
    map: new CanvasTexture(canvas),
    sizeAttenuation: false,
    depthTest: false,
    transparent: true,
  });
  const sprite = new Sprite(material);
  sprite.scale.set((SCREEN_HEIGHT * canvas.width) / HEIGHT_PX, SCREEN_HEIGHT, 1);
  sprite.center.set(0.5, -0.4);
  sprite.renderOrder = 10;
  return sprite;
}
