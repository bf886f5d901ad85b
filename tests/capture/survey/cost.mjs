// What recording costs: the time of a page's frames with and without it, and the size of what it writes. It prints a
// Markdown table.
//
// A frame's time is from one callback of requestAnimationFrame to the next, the median of `FRAMES`. Without a display, a
// page queues frames faster than its GPU draws them, so the ratio is to the frames of a page that waits for its GPU. The
// loaded recorder makes it wait, whether it records or not.

import { gzipSync } from 'node:zlib';
import { capture, launch, open } from '../browser.mjs';
import { serve } from '../serve.mjs';

const FRAMES = 30;
const PAGES = ['stress-webgl', 'stress-webgpu', 'babylon-webgl', 'babylon-webgpu', 'playcanvas-webgl', 'playcanvas-webgpu'];

/** Milliseconds between frames: the median of the next `count`. */
const interval = (page, count) =>
    page.evaluate(
        (count) =>
            new Promise((resolve) => {
                const times = [];
                const next = () => {
                    times.push(performance.now());
                    if (times.length <= count) return requestAnimationFrame(next);
                    const between = times.slice(1).map((time, i) => time - times[i]);
                    resolve(between.sort((a, b) => a - b)[count >> 1]);
                };
                requestAnimationFrame(next);
            }),
        count,
    );

/** The size of frame.json in a folder: large ones are compressed. */
const stored = (json) => (json.length > 64 << 10 ? gzipSync(json).length : json.length);

export async function cost() {
    const { server, address } = await serve();
    const browser = await launch();
    const rows = [];
    for (const name of PAGES) {
        const plain = await open(browser, `${address}/${name}`, { record: false });
        const alone = await interval(plain.page, FRAMES);
        await plain.page.close();
        const visited = await open(browser, `${address}/${name}`);
        // A B B A: without and with recording, since other work shares the machine.
        const paced = [await interval(visited.page, FRAMES)];
        const recorded = [];
        let files;
        for (let i = 0; i < 2; i++) {
            visited.chunks.length = 0;
            const recording = capture(visited, FRAMES + 5);
            recorded.push(await interval(visited.page, FRAMES));
            ({ files } = await recording);
        }
        paced.push(await interval(visited.page, FRAMES));
        await visited.page.close();
        const json = files.get('frame.json');
        const data = [...files.values()].reduce((sum, { length }) => sum + length, 0) - json.length;
        const mean = (times) => (times[0] + times[1]) / 2;
        rows.push({ name, alone, paced: mean(paced), recorded: mean(recorded), data, bytes: data + stored(json) });
    }
    await browser.close();
    server.close();
    return rows;
}

export function costTable(rows) {
    const ms = (time) => time.toFixed(1);
    const mib = (bytes) => (bytes / 2 ** 20).toFixed(2);
    const lines = rows.map(({ name, alone, paced, recorded, bytes, data }) => {
        const times = [ms(alone), ms(paced), ms(recorded), (recorded / paced).toFixed(2)];
        return `| \`${name}\` | ${[...times, mib(data), mib(bytes), (bytes / data).toFixed(2)].join(' | ')} |\n`;
    });
    return `| page | does not wait, ms | waits for its GPU | recording | ratio | data, MiB | folder, MiB | ratio |
|---|--:|--:|--:|--:|--:|--:|--:|
${lines.join('')}`;
}
