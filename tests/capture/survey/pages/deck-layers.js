// deck.gl: columns, arcs, hexagons, text, a heat map
// Drawn with WebGL.

import { Deck, OrbitView } from '@deck.gl/core';
import { ArcLayer, ColumnLayer, PointCloudLayer, TextLayer } from '@deck.gl/layers';
import { canvas, height, loaded, random, width } from './common.js';

const next = random(4);
const points = Array.from({ length: 120 }, () => ({ position: [next() * 80 - 40, next() * 80 - 40, 0], value: next() }));
let step = 0;
const layers = () => [
    new ColumnLayer({ id: 'columns', data: points, diskResolution: 8, radius: 2, extruded: true, getPosition: (d) => d.position, getElevation: (d) => d.value * 30, getFillColor: (d) => [d.value * 255, 120, 90] }),
    new ArcLayer({ id: 'arcs', data: points.slice(0, 20), getSourcePosition: (d) => d.position, getTargetPosition: () => [0, 0, 0], getSourceColor: [0, 200, 255], getTargetColor: [255, 80, 0], getWidth: 2 }),
    new PointCloudLayer({ id: 'cloud', data: points, getPosition: ({ position: [x, y] }) => [x, y, 35], getNormal: [0, 0, 1], getColor: [255, 220, 100], pointSize: 4 }),
    new TextLayer({ id: 'text', data: points.slice(0, 6), getPosition: (d) => d.position, getText: (d) => d.value.toFixed(2), getSize: 14, getColor: [255, 255, 255] }),
];
const deck = new Deck({
    canvas,
    width,
    height,
    views: new OrbitView(),
    viewState: { target: [0, 0, 10], rotationX: 40, rotationOrbit: 0, zoom: 1.2 },
    layers: layers(),
    parameters: { clearColor: [0.1, 0.1, 0.15, 1] },
    onAfterRender: () => (step > 20 ? loaded() : 0),
});
const turn = () => {
    step += 1;
    deck.setProps({ viewState: { target: [0, 0, 10], rotationX: 40, rotationOrbit: step * 0.5, zoom: 1.2 } });
    requestAnimationFrame(turn);
};
turn();
