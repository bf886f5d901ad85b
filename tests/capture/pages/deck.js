import { Deck, OrbitView } from '@deck.gl/core';
import { PathLayer, PolygonLayer, ScatterplotLayer } from '@deck.gl/layers';

const points = Array.from({ length: 200 }, (_, i) => ({
    position: [Math.cos(i * 0.5) * (20 + i / 4), Math.sin(i * 0.5) * (20 + i / 4), (i % 20) * 2],
    color: [(i * 7) % 255, 120, 255 - ((i * 3) % 255)],
}));
const square = (x, y) => [
    [x, y],
    [x + 14, y],
    [x + 14, y + 14],
    [x, y + 14],
];

let step = 0;
const layers = () => [
    new PolygonLayer({
        id: 'blocks',
        data: [square(-40, -40), square(20, 10), square(-10, 30)],
        getPolygon: (d) => d,
        extruded: true,
        getElevation: 25,
        getFillColor: [90, 140, 90],
    }),
    new ScatterplotLayer({
        id: 'points',
        data: points,
        getPosition: (d) => d.position,
        getFillColor: (d) => d.color,
        getRadius: 2,
        opacity: 0.8,
    }),
    new PathLayer({
        id: 'path',
        data: [points.map((d) => d.position)],
        getPath: (d) => d,
        getWidth: 0.6,
        getColor: [220, 60, 20],
    }),
];

const deck = new Deck({
    canvas: 'canvas',
    width: 320,
    height: 240,
    views: new OrbitView(),
    initialViewState: { target: [0, 0, 10], rotationX: 40, zoom: 1 },
    layers: layers(),
    onAfterRender: () => {
        step += 1;
        globalThis.ready = step > 3;
    },
});
const turn = () => {
    deck.setProps({ viewState: { target: [0, 0, 10], rotationX: 40, rotationOrbit: step, zoom: 1 } });
    requestAnimationFrame(turn);
};
turn();
