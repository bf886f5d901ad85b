// sigma.js: a graph of nodes and edges with labels
// Drawn with WebGL.

import Graph from 'graphology';
import Sigma from 'sigma';
import { height, loaded, loop, random, width, withoutCanvas } from './common.js';

withoutCanvas();
const holder = document.createElement('div');
holder.style.cssText = `width:${width}px;height:${height}px`;
document.body.append(holder);
const next = random(4);
const graph = new Graph();
for (let i = 0; i < 60; i++) graph.addNode(i, { x: next(), y: next(), size: 3 + next() * 6, label: `node ${i}`, color: `hsl(${i * 6} 60% 50%)` });
for (let i = 0; i < 120; i++) graph.mergeEdge(Math.floor(next() * 60), Math.floor(next() * 60), { size: 1 + next(), color: '#999' });
const sigma = new Sigma(graph, holder);
loaded();
loop((step) => {
    sigma.getCamera().setState({ angle: step * 0.01 });
    sigma.refresh();
});
