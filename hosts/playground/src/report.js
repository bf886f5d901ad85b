// A measurement as `docs/results` takes it: the schema `preshade.verify.v1`.

const EXACT = { kind: 'exact', given: [] };

/** The browser, as far as it says. */
export function browser() {
    const brands = navigator.userAgentData?.brands?.filter(({ brand }) => !/not.?a.?brand/i.test(brand)) ?? [];
    const known = brands.find(({ brand }) => brand !== 'Chromium') ?? brands[0];
    const system = navigator.userAgentData?.platform;
    if (known) return [`${known.brand} ${known.version}`, system].filter(Boolean).join(', ');
    const [, name, version] = /(Firefox|Version|Chrome)\/([\d.]+)/.exec(navigator.userAgent) ?? [];
    return name ? `${name === 'Version' ? 'Safari' : name} ${version}` : 'a browser';
}

const NONE = {
    shaded_per_pixel: null,
    cost: null,
    shadow: null,
    self_test: [],
    kept: [],
    by_path: [],
};

/** One variant of the report. */
function variant({ name, recipe, contract, verdict, error, time, speedup, order }) {
    const view = { camera: 'front', frame: 0, order, error, time_ms: time, speedup, shaded_per_pixel: null };
    return { name, recipe, contract, verdict, error, time_ms: time, speedup, ...NONE, by_view: [view] };
}

/** The JSON. `adapter` is the name that the visitor gave; what the browser says is beside it. */
export function report({ material, recipe, contract, drawn, timed, adapter, renderer, told, text }) {
    const { size, order, error, verdict, base } = drawn;
    const one = { median: 1, low: 1, high: 1 };
    const guessed = told.filter(({ guess }) => guess);
    const assumed = guessed.map(({ name, guess }) => ({ material, name, ...guess }));
    return {
        schema: 'preshade.verify.v1',
        scene: `${material} (made up by the playground)`,
        resolution: [size, size],
        samples: 1,
        command: `playground: ${recipe || 'original'}, ${size}x${size}, ${order}, ${renderer.name}`,
        adapter: {
            name: adapter,
            driver: `not told; ${browser()}`,
            backend: renderer.adapter.backend,
            kind: renderer.adapter.kind,
            timestamps: renderer.hasTimestamps,
            pipeline_statistics: false,
            features: renderer.adapter.features,
            browser_says: renderer.adapter.name,
        },
        clock: timed?.clock ?? null,
        depth_ties: null,
        made_up: true,
        assumed,
        variants: [
            variant({
                name: 'original',
                recipe: '',
                contract: EXACT,
                verdict: { kind: 'holds' },
                error: base,
                time: timed?.original ?? null,
                speedup: timed ? one : null,
                order,
            }),
            variant({
                name: recipe,
                recipe,
                contract,
                verdict,
                error,
                time: timed?.variant ?? null,
                speedup: timed?.speedup ?? null,
                order,
            }),
        ],
        frames_a_sample: timed?.repeats ?? null,
        ...(text && { shader: text }),
    };
}

/** The file's name: the adapter, the material and the recipe. */
export function fileName(adapter, material, recipe) {
    const plain = (text) =>
        text
            .toLowerCase()
            .replace(/[^a-z0-9]+/g, '-')
            .replace(/^-|-$/g, '');
    return `${[adapter, material, recipe].map(plain).filter(Boolean).join('-').slice(0, 120)}.json`;
}

/** `owner/name` of a repository's address on GitHub, or empty. */
export const onGitHub = (address) =>
    /^(?:https:\/\/|ssh:\/\/git@|git@)(?:[^@/]*@)?github\.com[:/]([\w.-]+\/[\w.-]+?)(?:\.git)?\/?\s*$/.exec(
        address,
    )?.[1] ?? '';

/** The address of a new issue, or `null` where the repository is not known. */
export function issueAddress(repository, { adapter, material, recipe }) {
    if (!repository) return null;
    const title = `Measurement: ${recipe} of ${material} on ${adapter}`;
    const body = 'Paste the JSON of the playground between the lines.\n\n```json\n\n```\n';
    return `https://github.com/${repository}/issues/new?${new URLSearchParams({ title, body })}`;
}
