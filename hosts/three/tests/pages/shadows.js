// Shadow maps of materials of every kind, each against the author's whole program drawn from the light.

import { cases as materials } from './lib/cases.js';
import { forms } from './lib/forms.js';
import { open, run, SunLight } from './lib/run.js';

const cases = { ...materials, ...forms };
if (!SunLight) for (const [name, { lights }] of Object.entries(cases)) if (lights?.includes('sun')) delete cases[name];
const renderers = new Map();

globalThis.runCases = async (names) => {
    const results = {};
    for (const [name, of] of Object.entries(cases)) {
        if (names && !names.includes(name)) continue;
        const key = JSON.stringify(of.context ?? {});
        if (!renderers.has(key)) renderers.set(key, open(of.context));
        results[name] = await run(renderers.get(key), of);
    }
    return results;
};
globalThis.names = Object.keys(cases);
globalThis.ready = true;
