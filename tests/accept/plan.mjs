// Creates the pipelines of plans with Dawn, from plan.json alone: explicit bind group layouts, attributes, targets and state.
//
// Paths of plan.json files come on stdin, one a line. The last line of stdout is one JSON array: [{"path": .., "pipelines": N, "errors": [..]}].
// A pass that needs what Dawn's null adapter lacks has no pipeline; `lacking` names it.
import { readFileSync } from 'node:fs';
import { dirname } from 'node:path';
import { create, globals } from 'webgpu';
import { dawn, pipelines } from './pipelines.mjs';

Object.assign(globalThis, globals);

const { device } = await dawn(create, 'null');
const { render, compute, lacks } = pipelines(device);

async function judged(path) {
    const folder = dirname(path);
    const plan = JSON.parse(readFileSync(path, 'utf8'));
    const result = { path, pipelines: 0, lacking: [], errors: [] };
    const passes = plan.passes.map((pass, i) => [pass, () => render(plan, pass, plan.files[i], folder)]);
    for (const [i, pass] of (plan.compute ?? []).entries())
        passes.push([pass, () => compute(pass, plan.compute_files[i], folder)]);
    const original = plan.original;
    if (original)
        for (const [i, pass] of original.passes.entries())
            passes.push([pass, () => render({ ...plan, ...original }, pass, original.files[i], folder)]);
    for (const [pass, make] of passes) {
        const missing = lacks(pass);
        if (missing.length > 0) {
            result.lacking.push(...missing);
            continue;
        }
        device.pushErrorScope('validation');
        let thrown;
        try {
            make();
        } catch (error) {
            thrown = `${error}`;
        }
        const error = await device.popErrorScope();
        const what = `pass ${pass.program}`;
        if (thrown) result.errors.push(`${what}: ${thrown}`);
        else if (error) result.errors.push(`${what}: ${error.message}`);
        else result.pipelines += 1;
    }
    return result;
}

const paths = readFileSync(0, 'utf8')
    .split('\n')
    .filter((path) => path !== '');
const results = [];
for (const path of paths) results.push(await judged(path));
// Dawn's threads keep node alive; leave once the pipe has taken everything.
process.stdout.write(`\n${JSON.stringify(results)}`, () => process.exit(0));
