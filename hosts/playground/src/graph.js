// The dataflow graph as a picture and as a list.

import dagre from '@dagrejs/dagre';
import { counted, h } from './dom.js';

/** A picture of more nodes is no help, and takes seconds to lay out. */
const MOST = 320;
const LINE = 15;

const svg = (name, attributes = {}, ...children) => {
    const element = document.createElementNS('http://www.w3.org/2000/svg', name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    element.append(...children);
    return element;
};

const short = (text, most = 38) => (text.length > most ? `${text.slice(0, most - 1)}\u2026` : text);

/** How often a value changes, in words. */
const RATES = {
    const: 'constant',
    draw: 'once a draw',
    instance: 'once an instance',
    vertex: 'once a vertex',
    perspective: 'interpolated',
    linear: 'interpolated in screen space',
    flat: 'once a triangle',
    mixed: 'of two interpolations',
    fragment: 'once a fragment',
    sample: 'once a sample',
};

/** The line of a node, from `FILE:LINE` or a location. */
const placeOf = ({ location, line }) => {
    if (location) return location;
    const [, file, number] = /^(.*):(\d+)$/.exec(line ?? '') ?? [];
    return file ? { file, line: Number(number), column: 1 } : null;
};

/** The answer of the compiler (`preshade.graph.v1`) as nodes and edges to draw. */
export function fromCompiler(graph) {
    return {
        isCoarse: false,
        functions: graph.functions.map(({ name, stage, cost }) => ({
            name,
            label: stage ? `${name} (${stage}, ${counted(cost, 'op')})` : name,
        })),
        nodes: graph.nodes.map((node) => ({
            ...node,
            title: node.name && node.name !== node.text ? `${node.name} = ${node.text}` : node.text,
            detail: [RATES[node.rate] ?? node.rate, node.cost ? counted(node.cost, 'op') : '', ...(node.effects ?? [])]
                .filter(Boolean)
                .join(', '),
            place: placeOf(node),
        })),
        edges: graph.edges,
    };
}

/** What `explain` and the plan say: inputs, stages and outputs. */
export function fromPlan(explained, plan) {
    const nodes = [];
    const add = (node) => nodes.push({ function: 'material', ...node }) - 1;
    const edges = [];
    const main = plan.passes.find(({ role }) => role === 'main') ?? plan.passes.at(-1);
    const stages = new Map(
        explained.stages.map(({ stage, entry_point: name, cost, effects }) => [
            stage,
            add({
                kind: 'statement',
                title: `${stage} stage ${name}`,
                rate: stage,
                detail: [counted(cost, 'op'), ...effects].join(', '),
            }),
        ]),
    );
    const [vertex, fragment] = [stages.get('vertex'), stages.get('fragment')];
    for (const { name, type } of main.attributes) {
        const from = add({ kind: 'input', title: `${name}: ${type}`, rate: 'vertex', detail: 'attribute' });
        edges.push({ from, to: vertex, kind: 'data' });
    }
    for (const { name, kind, visibility } of main.bindings) {
        const from = add({ kind: 'input', title: name, rate: 'draw', detail: kind });
        if (visibility.vertex) edges.push({ from, to: vertex, kind: 'data' });
        if (visibility.fragment && fragment !== undefined) edges.push({ from, to: fragment, kind: 'data' });
    }
    if (fragment !== undefined) edges.push({ from: vertex, to: fragment, kind: 'data' });
    for (const [i, target] of main.targets.entries()) {
        if (!target || fragment === undefined) continue;
        const to = add({ kind: 'output', title: `colour ${i}`, rate: 'fragment', detail: target.format });
        edges.push({ from: fragment, to, kind: 'data' });
    }
    if (main.depth) {
        const writes = explained.stages.some(({ effects }) => effects.includes('frag-depth'));
        const to = add({ kind: 'output', title: main.depth.attachment, rate: 'fragment', detail: 'depth' });
        edges.push({ from: writes ? fragment : vertex, to, kind: 'data' });
    }
    return { isCoarse: true, functions: [{ name: 'material', label: 'material' }], nodes, edges };
}

/**
 * The picture of one function. `go` is called with a place. Without branches, edges of control are left out, and nodes
 * that have no others: they pull everything apart.
 */
function picture(graph, name, go, hasBranches) {
    const isShown = ({ from, to, kind }) =>
        (hasBranches || kind !== 'control') && graph.nodes[from].function === name && graph.nodes[to].function === name;
    const edges = graph.edges.filter(isShown);
    const tied = new Set(edges.flatMap(({ from, to }) => [from, to]));
    const indices = graph.nodes.flatMap((node, i) => {
        const isEnd = node.kind === 'input' || node.kind === 'output';
        return node.function === name && (hasBranches || isEnd || tied.has(i)) ? [i] : [];
    });
    if (indices.length > MOST) return null;
    const layout = new dagre.graphlib.Graph({ multigraph: true });
    layout.setGraph({ rankdir: 'TB', nodesep: 18, ranksep: 30, marginx: 8, marginy: 8 });
    layout.setDefaultEdgeLabel(() => ({}));
    for (const i of indices) {
        const lines = [short(graph.nodes[i].title), short(graph.nodes[i].detail)];
        const width = Math.max(...lines.map((line) => line.length)) * 7.2 + 20;
        layout.setNode(String(i), { width, height: LINE * 2 + 12, lines });
    }
    for (const [e, { from, to, kind }] of edges.entries())
        layout.setEdge(String(from), String(to), { kind }, String(e));
    dagre.layout(layout);
    const { width, height } = layout.graph();
    const mark = svg('marker', {
        id: 'arrow',
        viewBox: '0 0 8 8',
        refX: 7,
        refY: 4,
        markerWidth: 7,
        markerHeight: 7,
        orient: 'auto',
    });
    mark.append(svg('path', { d: 'M0 0 8 4 0 8z', class: 'arrow' }));
    const root = svg(
        'svg',
        { viewBox: `0 0 ${width} ${height}`, width, height, class: 'graph', 'aria-hidden': 'true' },
        svg('defs', {}, mark),
    );
    const top = indices.map((i) => layout.node(String(i))).sort((a, b) => a.y - b.y)[0];
    root.dataset.first = top?.x ?? 0;
    for (const edge of layout.edges()) {
        const { points, kind } = layout.edge(edge);
        const d = points.map(({ x, y }, i) => `${i ? 'L' : 'M'}${x.toFixed(1)} ${y.toFixed(1)}`).join('');
        root.append(svg('path', { d, class: `edge ${kind}`, 'marker-end': 'url(#arrow)' }));
    }
    for (const i of indices) {
        const { x, y, width: w, height: t, lines } = layout.node(String(i));
        const node = graph.nodes[i];
        const title = svg('title', {}, [node.title, node.detail].filter(Boolean).join('\n'));
        const box = svg('rect', {
            x: x - w / 2,
            y: y - t / 2,
            width: w,
            height: t,
            rx: node.kind === 'expression' ? 12 : 3,
        });
        const text = lines.map((line, l) =>
            svg('text', { x, y: y - 3 + l * LINE, 'text-anchor': 'middle', class: l ? 'detail' : '' }, line),
        );
        const group = svg('g', { class: `node ${node.kind} rate-${node.rate}` }, title, box, ...text);
        if (node.place) {
            group.classList.add('linked');
            group.addEventListener('click', () => go(node.place));
        }
        root.append(group);
    }
    return root;
}

/** The graph of one function as rows: the same for those who do not see the picture. */
function rows(graph, name, go) {
    const feeds = new Map();
    for (const { from, to } of graph.edges) feeds.set(to, [...(feeds.get(to) ?? []), from]);
    const all = graph.nodes.map((node, i) => [node, i]).filter(([node]) => node.function === name);
    const line = (place) =>
        place ? h('button', { type: 'button', class: 'link', onclick: () => go(place) }, `line ${place.line}`) : '';
    const body = all.slice(0, 2000).map(([node, i]) => {
        const from = (feeds.get(i) ?? [])
            .filter((of) => graph.nodes[of].function === name)
            .map((of) => short(graph.nodes[of].title, 24));
        return h('tr', {}, [
            h('td', {}, h('code', {}, short(node.title, 80))),
            h('td', {}, node.kind),
            h('td', {}, node.detail),
            h('td', {}, from.join('; ')),
            h('td', {}, line(node.place)),
        ]);
    });
    const head = ['Value', 'Kind', 'How often, and cost', 'Read from', 'Where'].map((text) =>
        h('th', { scope: 'col' }, text),
    );
    return h('table', {}, h('thead', {}, h('tr', {}, head)), h('tbody', {}, body));
}

/** The graph as elements. */
export function draw(graph, go) {
    const place = h('div', {});
    const region = { class: 'scroll', tabindex: '0', role: 'region' };
    const branches = h('input', { type: 'checkbox', id: 'graph-branches', onchange: () => show() });
    const fit = h('input', { type: 'checkbox', id: 'graph-fit', onchange: () => show() });
    const first = graph.functions.at(-1)?.name;
    const choose = h(
        'select',
        { id: 'graph-function', onchange: () => show() },
        graph.functions.map(({ name, label }) => h('option', { value: name, selected: name === first }, label)),
    );
    const show = () => {
        const name = choose.value;
        const made = picture(graph, name, go, branches.checked);
        if (made && fit.checked) made.classList.add('fit');
        const count = graph.nodes.filter((node) => node.function === name).length;
        const scroll = h('div', { ...region, 'aria-label': `Graph of ${name}. The list below says the same.` });
        if (made) scroll.append(made);
        place.replaceChildren(
            made ? scroll : h('p', {}, `${counted(count, 'node')}: too many for a picture. The list has them.`),
            h(
                'details',
                { open: !made },
                h('summary', {}, `As a list: ${counted(count, 'node')}`),
                h('div', { ...region, 'aria-label': `Nodes of ${name}` }, rows(graph, name, go)),
            ),
        );
        // A wide picture begins with its first values in sight.
        if (made) requestAnimationFrame(() => (scroll.scrollLeft = made.dataset.first - scroll.clientWidth / 2));
    };
    if (first) show();
    const bar = h(
        'div',
        { class: 'bar' },
        graph.functions.length > 1 && h('label', {}, 'Function ', choose),
        graph.edges.some(({ kind }) => kind === 'control') && h('label', {}, branches, ' Branches'),
        h('label', {}, fit, ' Fit to the width'),
    );
    return [bar, place];
}
