// Where Chromium is, and how it draws in software: for the tests of all packages.

import { existsSync } from 'node:fs';

export const PLACES = ['/usr/bin/chromium', '/usr/bin/chromium-browser', '/usr/bin/google-chrome'];
export const WEBGL = [
    '--no-sandbox',
    '--disable-dev-shm-usage',
    '--use-angle=swiftshader',
    '--enable-unsafe-swiftshader',
];
export const WEBGPU = [
    '--enable-unsafe-webgpu',
    '--use-webgpu-adapter=swiftshader',
    // Without Vulkan, copyExternalImageToTexture ends the GPU process.
    '--enable-features=Vulkan',
    '--use-vulkan=swiftshader',
    '--disable-vulkan-surface',
];

/** A browser. `chromium`: playwright's, of the package that asks. `webgpu`: with WebGPU. `args`: more of Chromium's flags. */
export function launch(chromium, { webgpu = false, args = [] } = {}) {
    const executablePath = process.env.CHROMIUM ?? PLACES.find(existsSync);
    if (!executablePath) throw new Error('no Chromium: scripts/setup.sh three installs it, or name one by CHROMIUM');
    return chromium.launch({ executablePath, args: [...WEBGL, ...(webgpu ? WEBGPU : []), ...args], timeout: 120_000 });
}
