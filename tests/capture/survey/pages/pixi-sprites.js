// PixiJS: sprites, graphics, text, a mesh, masks, blend modes, blur and displacement filters
// Drawn with WebGL and WebGPU.

import * as PIXI from 'pixi.js';
import { bumps, canvas, checks, height, isWebgpu, loaded, random, spot, width } from './common.js';

const next = random(9);
const app = new PIXI.Application();
await app.init({ canvas, width, height, preference: isWebgpu ? 'webgpu' : 'webgl', background: '#203040', antialias: true });
const tiles = new PIXI.TilingSprite({ texture: PIXI.Texture.from(checks('#345', '#234')), width, height });
app.stage.addChild(tiles);
const dots = new PIXI.Container();
const dot = PIXI.Texture.from(spot('#ffcc66'));
for (let i = 0; i < 60; i++) {
    const sprite = new PIXI.Sprite(dot);
    sprite.anchor.set(0.5);
    sprite.position.set(next() * width, next() * height);
    sprite.scale.set(0.2 + next() * 0.6);
    sprite.tint = Math.floor(next() * 0xffffff);
    sprite.blendMode = i % 2 ? 'add' : 'normal';
    dots.addChild(sprite);
}
app.stage.addChild(dots);
const shapes = new PIXI.Graphics();
shapes.roundRect(20, 20, 90, 60, 12).fill({ color: 0x3388ff, alpha: 0.8 }).stroke({ width: 4, color: 0xffffff });
shapes.star(240, 70, 7, 50, 24).fill(0xff5577);
shapes.moveTo(20, 200).bezierCurveTo(100, 100, 200, 260, 300, 160).stroke({ width: 6, color: 0x88ff88 });
app.stage.addChild(shapes);
const text = new PIXI.Text({ text: 'captured', style: { fontSize: 36, fill: 0xffffff, stroke: { color: 0x000000, width: 4 } } });
text.position.set(90, 100);
text.filters = [new PIXI.BlurFilter({ strength: 2 })];
app.stage.addChild(text);
const round = new PIXI.Sprite(PIXI.Texture.from(checks('#f80', '#08f')));
round.position.set(30, 130);
const mask = new PIXI.Graphics().circle(62, 162, 30).fill(0xffffff);
round.mask = mask;
app.stage.addChild(mask, round);
const waves = new PIXI.Sprite(PIXI.Texture.from(bumps()));
const bent = new PIXI.Sprite(PIXI.Texture.from(checks()));
bent.position.set(200, 140);
bent.scale.set(1.5);
bent.filters = [new PIXI.DisplacementFilter({ sprite: waves, scale: 20 }), new PIXI.ColorMatrixFilter()];
waves.position.copyFrom(bent.position);
waves.renderable = false;
app.stage.addChild(waves, bent);
let step = 0;
app.ticker.add(() => {
    step += 1;
    dots.children.forEach((sprite, i) => (sprite.rotation = step * 0.02 + i));
    tiles.tilePosition.x = step;
});
loaded();
