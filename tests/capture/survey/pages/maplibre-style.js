// MapLibre GL: fills, extrusions, lines with dashes, circles and a heat map of GeoJSON
// Drawn with WebGL.

import * as maplibregl from 'maplibre-gl';
import { height, loaded, random, width, withoutCanvas } from './common.js';

withoutCanvas();
maplibregl.setWorkerUrl?.('/npm/maplibre-gl/dist/maplibre-gl-worker.mjs');
const holder = document.createElement('div');
holder.style.cssText = `width:${width}px;height:${height}px`;
document.body.append(holder);
const next = random(8);
const square = (x, y, side) => [[[x, y], [x + side, y], [x + side, y + side], [x, y + side], [x, y]]];
const features = Array.from({ length: 40 }, () => ({
    type: 'Feature',
    properties: { high: next() * 300, hue: next() * 360 },
    geometry: { type: 'Polygon', coordinates: square(next() * 0.02, next() * 0.02, 0.0015) },
}));
const dots = features.map(({ geometry }) => ({ type: 'Feature', properties: {}, geometry: { type: 'Point', coordinates: geometry.coordinates[0][0] } }));
const path = { type: 'Feature', properties: {}, geometry: { type: 'LineString', coordinates: dots.map((dot) => dot.geometry.coordinates) } };
const source = (list) => ({ type: 'geojson', data: { type: 'FeatureCollection', features: list } });
const map = new maplibregl.Map({
    container: holder,
    center: [0.01, 0.01],
    zoom: 14,
    pitch: 55,
    bearing: 20,
    fadeDuration: 0,
    attributionControl: false,
    style: {
        version: 8,
        sources: { blocks: source(features), dots: source(dots), path: source([path]) },
        layers: [
            { id: 'ground', type: 'background', paint: { 'background-color': '#dfe8d8' } },
            { id: 'heat', type: 'heatmap', source: 'dots', paint: { 'heatmap-radius': 30 } },
            { id: 'plots', type: 'fill', source: 'blocks', paint: { 'fill-color': '#b0c090', 'fill-outline-color': '#445533' } },
            { id: 'path', type: 'line', source: 'path', paint: { 'line-width': 4, 'line-color': '#cc5522', 'line-dasharray': [2, 1] } },
            { id: 'dots', type: 'circle', source: 'dots', paint: { 'circle-radius': 5, 'circle-color': '#2255cc', 'circle-stroke-width': 1 } },
            {
                id: 'blocks',
                type: 'fill-extrusion',
                source: 'blocks',
                paint: { 'fill-extrusion-height': ['get', 'high'], 'fill-extrusion-color': ['interpolate', ['linear'], ['get', 'hue'], 0, '#cc6644', 360, '#4466cc'], 'fill-extrusion-opacity': 0.9 },
            },
        ],
    },
});
map.once('idle', loaded);
let turn = 20;
map.on('render', () => {
    if (globalThis.loaded) map.setBearing((turn += 0.3));
});
map.once('idle', () => map.setBearing(21));
