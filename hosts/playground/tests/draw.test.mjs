// Both drawings on both interfaces: the pictures, the error, what is not drawn, times, and the file of a measurement.

import assert from 'node:assert/strict';
import { test } from 'node:test';
import { fixture, launch, paste, settled, visitor } from './support.mjs';

const held = launch();

const visitPage = visitor(held);

/** The panel that draws, for one test. */
async function visit(context, options) {
    const page = await visitPage(context, options);
    await settled(page, 'depth-prepass');
    await page.click('#tab-draw');
    await page.waitForSelector('#draw');
    await page.selectOption('#draw-size', '128');
    if (!options) await page.selectOption('#draw-api', 'webgpu');
    return page;
}

const choose = async (page, recipe) => {
    await page.check(`.pass input[value="${recipe}"]`);
    await settled(page, recipe);
    await page.waitForFunction(() => /Not drawn yet/.test(document.querySelector('#draw-result')?.textContent));
};

/** Draws, and what is said of it. */
async function draw(page) {
    await page.click('#draw');
    const said = page.locator('#draw-verdict, #not-drawn');
    await said.waitFor();
    return said.textContent();
}

/** Texels of the three pictures. */
const pictures = (page) =>
    page.$$eval('#draw-result canvas', (all) =>
        all.map((canvas) => [...canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data]),
    );
const colours = (texels) =>
    new Set(Array.from({ length: texels.length / 4 }, (_, i) => texels.slice(i * 4, i * 4 + 3).join())).size;
const row = async (page, name) => page.locator('#error tr', { hasText: name }).locator('td').textContent();

const APIS = [
    ['webgpu', 'WebGPU'],
    ['webgl', 'WebGL 2'],
];
const EXACT = [
    ['A leaf with an alpha test', ['depth-prepass', 'early-discard', 'hoist']],
    ['An alpha test behind expensive work', ['early-alpha']],
    ['Parquet that writes depth', ['early-discard']],
    ['GLSL: a cut-out', ['depth-prepass']],
    ['GLSL: Phong', ['early-discard']],
];

for (const [api, name] of APIS) {
    test(`${name}: exact variants draw the original's picture`, async (context) => {
        const page = await visit(context);
        await page.selectOption('#draw-api', api);
        for (const [example, recipes] of EXACT) {
            await page.selectOption('#example', { label: example });
            await settled(page);
            for (const recipe of recipes) {
                await page.check(`.pass input[value="${recipe}"]`);
                await settled(page, recipe);
                await page.waitForSelector('#draw');
                assert.equal(
                    await draw(page),
                    'The pictures are the same, bit for bit, for these inputs.',
                    `${example}, ${recipe}`,
                );
                const [original, variant, difference] = await pictures(page);
                assert.ok(colours(original) > 8, `${example} shows something`);
                assert.deepEqual(variant, original);
                assert.equal(colours(difference), 1);
                assert.equal(await row(page, 'Pixels that differ'), '0 of 16,384');
                assert.equal(await row(page, 'Depths that differ'), '0');
                assert.match(await page.textContent('#draw-result'), new RegExp(`Drawn with ${name}`));
            }
        }
    });

    test(`${name}: an approximate variant shows where it differs, and is held to its budget`, async (context) => {
        const page = await visit(context);
        await page.selectOption('#draw-api', api);
        await choose(page, 'trim-loop:budget=0.02');
        assert.match(
            await draw(page),
            /^The variant (keeps|does not keep) its promise for these inputs.* pixels of 16,384 differ\./,
        );
        const [original, variant, difference] = await pictures(page);
        let differ = 0;
        let most = 0;
        for (let i = 0; i < original.length; i += 4) {
            const steps = Math.max(...[0, 1, 2].map((c) => Math.abs(original[i + c] - variant[i + c])));
            most = Math.max(most, steps);
            if (steps) differ++;
            assert.equal(difference[i] + difference[i + 1] + difference[i + 2] > 0, steps > 0, `pixel ${i / 4}`);
        }
        assert.ok(differ > 0);
        assert.equal(await row(page, 'Pixels that differ'), `${differ.toLocaleString('en')} of 16,384`);
        assert.equal(await row(page, 'Maximum difference'), `${most} of 255`);
        const { error, verdict } = JSON.parse(await page.inputValue('#report')).variants[1];
        assert.ok(error.flip_mean > 0 && error.flip_p99 >= error.flip_mean);
        assert.equal(verdict.kind, error.flip_mean <= 0.02 ? 'holds' : 'broken');
    });

    test(`${name}: a variant that breaks its promise is shown broken`, async (context) => {
        // The pre-pass keeps more of the leaf than the main pass: what the compiler must never write.
        const init = () => {
            const Worker = globalThis.Worker;
            globalThis.Worker = class extends Worker {
                set onmessage(listener) {
                    super.onmessage = (event) => {
                        const text = JSON.stringify(event.data);
                        const files = event.data.answer?.report?.materials?.[0]?.files ?? [];
                        if (!files.some((file) => /prepass/.test(file.name))) return listener(event);
                        const answer = JSON.parse(text);
                        for (const file of answer.answer.report.materials[0].files)
                            if (/prepass/.test(file.name)) file.text = file.text.replace('< 0.5', '< 0.02');
                        listener({ data: answer });
                    };
                }
            };
        };
        const page = await visit(context, { init });
        await page.selectOption('#draw-api', api);
        assert.match(await draw(page), /^The variant promises the exact picture, and .* differ\. Check the conditions/);
        assert.equal(await page.getAttribute('#draw-verdict', 'class'), 'bad');
    });

    test(`${name}: both are timed in turn, with an interval, and the clock is named`, async (context) => {
        const page = await visit(context);
        await page.selectOption('#draw-api', api);
        await draw(page);
        await page.selectOption('#draw-seconds', '1');
        await page.click('#time');
        await page.waitForSelector('#times');
        const table = await page.textContent('#times');
        const clock = /by (the GPU’s own clock \(timestamp queries\)|the CPU’s clock: frame times)/;
        assert.match(table, clock);
        assert.match(
            table,
            /Original[\d.]+ ms[\d.]+ to [\d.]+Variant[\d.]+ ms[\d.]+ to [\d.]+Speedup[\d.]+x[\d.]+ to [\d.]+/,
        );
        assert.match(await page.textContent('#time-words'), /faster|slower|No difference/);
        assert.match(await page.textContent('#time-result'), /draws in software/);
        assert.equal(await page.textContent('#status'), await page.textContent('#time-words'));
        const made = JSON.parse(await page.inputValue('#report'));
        const [original, variant] = made.variants;
        assert.equal(made.clock, /queries/.test(table) ? 'gpu-timestamps' : 'wall-clock');
        assert.ok(original.time_ms.samples.length >= 8);
        assert.equal(original.time_ms.samples.length, variant.time_ms.samples.length);
        assert.ok(variant.speedup.low <= variant.speedup.median && variant.speedup.median <= variant.speedup.high);
        assert.ok([...original.time_ms.samples, ...variant.time_ms.samples].every((ms) => ms > 0));
    });

    test(`${name}: without timestamp queries there are frame times, and the page says so`, async (context) => {
        const init = () => {
            const has = globalThis.GPUSupportedFeatures?.prototype.has;
            if (has)
                GPUSupportedFeatures.prototype.has = function (name) {
                    return name !== 'timestamp-query' && has.call(this, name);
                };
            const { getExtension } = WebGL2RenderingContext.prototype;
            WebGL2RenderingContext.prototype.getExtension = function (name) {
                return /timer_query/.test(name) ? null : getExtension.call(this, name);
            };
        };
        const page = await visit(context, { init });
        await page.selectOption('#draw-api', api);
        await draw(page);
        await page.selectOption('#draw-seconds', '1');
        assert.match(await page.textContent('#draw-result'), /timed by the CPU’s clock: frame times/);
        await page.click('#time');
        await page.waitForSelector('#times');
        assert.match(await page.textContent('#times'), /by the CPU’s clock: frame times/);
        const made = JSON.parse(await page.inputValue('#report'));
        assert.equal(made.clock, 'wall-clock');
        assert.equal(made.adapter.timestamps, false);
    });
}

test('timing can be stopped', async (context) => {
    const page = await visit(context);
    await draw(page);
    await page.selectOption('#draw-seconds', '10');
    await page.click('#time');
    await page.click('#time-stop');
    await page.waitForSelector('#time-words');
    assert.equal(await page.textContent('#time-words'), 'Stopped: there are no times.');
    assert.equal(JSON.parse(await page.inputValue('#report')).clock, null);
});

test('what cannot be drawn is said with its reason, and nothing is shown in its place', async (context) => {
    const page = await visit(context);
    const refused = async (reason) => {
        assert.match(await draw(page), reason);
        assert.equal(await page.locator('#draw-result canvas').count(), 0);
        assert.equal(await page.locator('#draw-verdict, #report').count(), 0);
        assert.match(await page.textContent('#status'), /^Not drawn\./);
    };
    await choose(page, 'visibility-buffer:budget=0.02');
    await refused(/Not drawn\..*storage buffer|Not drawn\..*other geometry/);
    await choose(page, 'shadow');
    await refused(/there are no two pictures to compare.*shadow is not drawn/);
    await choose(page, 'early-alpha');
    await refused(/there are no two pictures to compare/);
    await page.click('#settings summary');
    await page.selectOption('#state-samples', '4');
    await choose(page, 'early-discard');
    await page.waitForSelector('#draw');
    await refused(/4 samples a pixel; this page draws one/);
});

test('a material that reads a storage buffer is not drawn', async (context) => {
    const page = await visit(context);
    await paste(page, fixture('shaders/skinned.wgsl'));
    await settled(page);
    await page.waitForSelector('#draw');
    assert.match(await draw(page), /reads a storage buffer \(joint_matrices\), whose content this page cannot make up/);
});

test('a picture of one colour proves nothing', async (context) => {
    const page = await visit(context);
    await paste(page, fixture('pages/leaf.wgsl').replace('texel.a < 0.5', 'texel.a < 2.0'));
    await settled(page);
    await page.waitForSelector('#draw');
    assert.match(await draw(page), /^No verdict: the original’s picture has one colour/);
    assert.equal(JSON.parse(await page.inputValue('#report')).variants[1].verdict.kind, 'not-measured');
});

test('without a GPU the page says so, and the rest of it works', async (context) => {
    const init = () => {
        Object.defineProperty(navigator, 'gpu', { get: () => undefined });
        const { getContext } = HTMLCanvasElement.prototype;
        HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
            return kind === 'webgl2' ? null : getContext.call(this, kind, ...more);
        };
    };
    const page = await visit(context, { init });
    const apis = await page.locator('#draw-api option').allTextContents();
    assert.deepEqual(apis, ['WebGPU (not in this browser)', 'WebGL 2 (not in this browser)']);
    assert.match(await draw(page), /This browser has no WebGL 2\./);
    await page.click('#tab-plan');
    assert.match(await page.textContent('#panel-plan'), /Draw 2 passes/);
});

test('without WebGPU, WebGL 2 draws', async (context) => {
    const init = () => Object.defineProperty(navigator, 'gpu', { get: () => undefined });
    const page = await visit(context, { init });
    assert.equal(await page.inputValue('#draw-api'), 'webgl');
    assert.match(await draw(page), /the same, bit for bit/);
});

test('what was made up is listed, and a recipe for certain values is drawn with them', async (context) => {
    const page = await visit(context);
    await draw(page);
    assert.match(await page.textContent('#panel-draw'), /The inputs are made up\./);
    await page.click('#made-up summary');
    const told = await page.textContent('#made-up');
    for (const words of [
        'nine spheres',
        'camera: world to clip',
        'fog: made up: 0.',
        'leaf: a checker with round holes',
    ])
        assert.ok(told.includes(words), `${words} in ${told}`);
    await page.fill('#own-recipe', 'specialize:set=fog=0');
    await page.press('#own-recipe', 'Enter');
    await settled(page, 'specialize:set=fog=0');
    await page.waitForSelector('#draw');
    assert.match(await draw(page), /the same, bit for bit/);
    assert.match(await page.textContent('#made-up'), /fog: 0, which the variant was made for/);
});

test('a measurement has the fields that docs/results reads, and nothing of the shader unless asked', async (context) => {
    const page = await visit(context);
    await draw(page);
    await page.fill('#adapter-name', 'Acme 9000 "Turbo"');
    const made = JSON.parse(await page.inputValue('#report'));
    assert.equal(made.schema, 'preshade.verify.v1');
    assert.equal(made.scene, 'leaf (made up by the playground)');
    assert.deepEqual(made.resolution, [128, 128]);
    assert.equal(made.adapter.name, 'Acme 9000 "Turbo"');
    assert.match(made.adapter.browser_says, /swiftshader/i);
    assert.equal(made.adapter.kind, 'software');
    assert.match(made.adapter.driver, /Chrom/);
    assert.equal(made.made_up, true);
    assert.deepEqual(
        made.assumed.find(({ name }) => name === 'camera'),
        {
            material: 'leaf',
            name: 'camera',
            guess: 'uniform-by-name',
            value: '$viewprojection',
        },
    );
    assert.deepEqual(
        made.variants.map(({ name }) => name),
        ['original', 'depth-prepass:form=biased'],
    );
    for (const {
        recipe,
        verdict,
        error,
        kept,
        by_view: [view],
    } of made.variants) {
        assert.equal(typeof recipe, 'string');
        assert.deepEqual(verdict, { kind: 'holds' });
        for (const key of ['changed_pixels', 'changed_depth', 'max_abs', 'flip_mean']) assert.equal(error[key], 0, key);
        assert.deepEqual(kept, []);
        assert.equal(view.camera, 'front');
        assert.deepEqual(view.error, error);
    }
    assert.ok(!(await page.inputValue('#report')).includes('textureSample'));
    await page.check('#with-text');
    const [file] = JSON.parse(await page.inputValue('#report')).shader;
    assert.equal(file.text, fixture('pages/leaf.wgsl'));
    const [download] = await Promise.all([page.waitForEvent('download'), page.click('#save')]);
    assert.equal(download.suggestedFilename(), 'acme-9000-turbo-leaf-depth-prepass-form-biased.json');
    assert.match(await page.textContent('#send'), /Open a new issue/);
});
