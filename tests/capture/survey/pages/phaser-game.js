// Phaser: sprites, tweens, particles, lights, blend modes, text
// Drawn with WebGL.

import * as Phaser from 'phaser';
import { canvas, checks, height, loaded, random, spot, width } from './common.js';

const next = random(6);
new Phaser.Game({
    type: Phaser.WEBGL,
    canvas,
    width,
    height,
    backgroundColor: '#223344',
    audio: { noAudio: true },
    banner: false,
    scene: {
        create() {
            this.textures.addCanvas('tile', checks('#789', '#567'));
            this.textures.addCanvas('spot', spot('#fc6'));
            this.add.tileSprite(width / 2, height / 2, width, height, 'tile').setTint(0x88aacc);
            this.sprites = Array.from({ length: 40 }, (_, i) =>
                this.add
                    .image(next() * width, next() * height, i % 2 ? 'spot' : 'tile')
                    .setScale(0.3 + next() * 0.4)
                    .setTint(Math.floor(next() * 0xffffff))
                    .setBlendMode(i % 3 ? 'NORMAL' : 'ADD'),
            );
            const drawn = this.add.graphics();
            drawn.fillStyle(0xff5566, 0.8).fillCircle(60, 60, 30);
            drawn.lineStyle(4, 0xffffff).strokeRoundedRect(180, 40, 100, 60, 12);
            this.add.particles(160, 200, 'spot', { speed: 60, scale: { start: 0.4, end: 0 }, blendMode: 'ADD', frequency: 40 });
            this.add.text(90, 110, 'captured', { fontSize: '32px', color: '#fff' });
            loaded();
        },
        update() {
            this.sprites.forEach((sprite, i) => (sprite.rotation += 0.01 * (i % 5)));
        },
    },
});
