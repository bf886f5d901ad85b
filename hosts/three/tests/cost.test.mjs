// What shadows cost in a scene of 200 casters. It prints times, and asserts none: `FRAMES=120` for steadier ones.

import assert from 'node:assert/strict';
import test from 'node:test';
import { launch, open } from './browser.mjs';
import { serve } from './serve.mjs';

const FRAMES = Number(process.env.FRAMES ?? 16);

test('the cost of 200 casters', async (context) => {
    const { address, close } = await serve();
    context.after(close);
    const browser = await launch();
    context.after(() => browser.close());
    const { page, errors } = await open(browser, `${address}/page/cost`);
    const { times, longest, states } = await page.evaluate((frames) => globalThis.measureCost(frames), FRAMES);
    for (const [name, { script, whole }] of Object.entries(times))
        context.diagnostic(
            `${name}: ${script.join(', ')} ms in script, ${whole.join(', ')} ms in all (a tenth, half, nine tenths of frames)`,
        );
    for (const [name, { count, longest: ms }] of Object.entries(longest))
        context.diagnostic(`${name}: ${count} times, ${ms.toFixed(1)} ms at most`);
    assert.deepEqual(states, { done: 16, same: 4 });
    assert.ok(longest['preshade: link'].count > 0);
    assert.deepEqual(errors, []);
});
