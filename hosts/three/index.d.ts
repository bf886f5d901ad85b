import type { Camera, Material, Object3D, Scene, Texture } from 'three';

export interface Options {
    /** Where `preshade.wasm` is: see the package `preshade`. */
    wasm?: string | URL | ArrayBuffer | Uint8Array | WebAssembly.Module;
    /** Where `preshade-full.wasm` is. It is loaded if a material may be drawn right by three.js itself. */
    full?: string | URL | ArrayBuffer | Uint8Array | WebAssembly.Module;
    /** Milliseconds after which the compiler gives up on a variant: 60,000. */
    timeout?: number;
    /** Whether to keep variants in IndexedDB: true. */
    cache?: boolean;
    /** How many variants are kept in memory: 512. */
    limit?: number;
    /** Whether each piece of our work on the main thread is in the performance timeline, as `preshade: ..`: false. */
    marks?: boolean;
}

/** What preshade does for one renderer. */
export declare class Preshade {
    /** For a `WebGLRenderer` or a `WebGPURenderer`. Nothing is drawn otherwise until you call a function below. */
    static of(renderer: object, options?: Options): Promise<Preshade>;
    /**
     * Right shadows of everything in `scene` that moves vertices or cuts holes, of objects and materials added later too.
     * `scene` is what you give to `renderer.render`. The same scene has the same `Part`.
     */
    shadows(scene: Object3D, options?: ShadowOptions): Part;
    /** Normals and depth of the real geometry in a pass that overrides materials: an object with `render`. Returns the pass. */
    override<Pass extends object>(pass: Pass): Pass;
    /** A depth pre-pass for each material for which it pays on this device. */
    prepass(scene: Scene, options?: PrepassOptions): Prepass;
    /** Each opaque material drawn by any recipe of preshade's passes. Of a `WebGPURenderer` it throws. */
    rewrite(scene: Scene, options: RewriteOptions): Rewrite;
    /** Velocities of the real geometry. */
    velocity(scene: Scene, options?: VelocityOptions): Velocity;
    report(): Row[];
    /** Resolves when no variant is being made and no program is being linked. */
    settled(): Promise<void>;
    /** Ends the worker, releases every program and texture, and has three.js draw as always. */
    dispose(): void;
}

export interface ShadowOptions {
    /**
     * What becomes of discards that depend on the viewer, such as fades by distance and parallax. `drop`, the default: a
     * shadow has none. `keep`: they follow the light.
     */
    view?: 'drop' | 'keep';
    /** Whether to draw over `customDepthMaterial` and `customDistanceMaterial` of objects: false. */
    replaceCustom?: boolean;
}

/** Passes in order, as preshade's `rewrite` takes them: `['hoist', 'depth-prepass']`. */
export type Recipe = string | string[];

/** What `prepass` and `rewrite` have in common. */
export interface PlanOptions {
    /** Whether to measure first, and to draw by a plan only where it pays: false. Without, each material is drawn by its plan. */
    measure?: boolean | MeasureOptions;
    /** The materials it is for; by default all. */
    materials?: Material[] | ((material: Material) => boolean);
    /** Whether what was measured is kept in localStorage: true. */
    keep?: boolean;
}

export interface RewriteOptions extends PlanOptions {
    /** The recipe. A function is asked once for each material; `null` has three.js draw it. */
    pass: Recipe | ((material: Material) => Recipe | null);
    /** Tried where `pass` is refused, or where its self-test fails. Without one, three.js draws as always. */
    fallback?: Recipe | ((material: Material) => Recipe | null) | null;
}

export interface PrepassOptions extends PlanOptions {
    /** `equal` shades each pixel once, by a main pass of its own; `biased` keeps the author's main pass. Default: `equal`. */
    form?: 'equal' | 'biased';
}

export interface MeasureOptions {
    /** Frames of a comparison: 30, rounded up to blocks of four. */
    frames?: number;
    /** Up to so many materials are measured one by one as well: 6. */
    each?: number;
    /** By which factor the fragments per pixel have to change until it is measured again: 1.3. */
    factor?: number;
    /** By default `timer-query`, where the driver has it. */
    method?: 'timer-query' | 'fence';
}

export interface Rewrite extends Part {
    /** Whether nothing is compiled, tested or measured. Tests and measurements need frames. */
    readonly isSettled: boolean;
    /** Draws by all plans, whatever was measured. */
    forced: boolean;
}

export type Prepass = Rewrite;

export interface VelocityOptions {
    /** `ndc`: normalised device coordinates, y up, as of three.js's `VelocityNode`. `picture`: parts of the picture, y down. Default: `ndc`. */
    units?: 'ndc' | 'picture';
    /** Whose frames; by default the camera of the first one. */
    camera?: Camera;
    /** Whether transparent objects are drawn too: false. */
    transparent?: boolean;
}

export interface Part {
    /** Switches it off and on. */
    enabled: boolean;
    report(): Row[];
    dispose(): void;
}

export interface Velocity extends Part {
    /** Two half floats, as large as what the scene is drawn into. The same object for good. */
    readonly texture: Texture;
    /** `WebGPURenderer`: the texture as a node, for `traa` and `motionBlur`. */
    readonly node?: object;
    /** `WebGPURenderer`: draws the velocities of a frame; you call it with the option `automatic: false`. */
    render?(camera: Camera): void;
}

/** What is done for a material in one pass. A material with several programs may have several rows. */
export interface Row {
    /** `shadow`, `override`, `prepass`, `rewrite`, `velocity`. */
    pass: string;
    /** The name of the material, else its type. */
    material: string;
    uuid: string;
    /**
     * `done`: drawn by preshade. `same`: three.js does the same by itself. `pending`: its variant is being made. `waiting`:
     * three.js has not made its program yet. `refused`: `reason` says why. `failed`: the text or the program has an error.
     * `unsupported`: this renderer or object is not one that it is for.
     */
    state: 'done' | 'same' | 'pending' | 'waiting' | 'refused' | 'failed' | 'unsupported';
    reason: string | null;
    /** What would make it possible. */
    remedy: string | null;
    /** The compiler's code of a refusal or an error. */
    code: string | null;
    /** Milliseconds that the compiler took; 0 if the variant was in IndexedDB. */
    ms: number;
    /** Shadows: what was left out of the author's discards, because it depends on the viewer. */
    left_out?: string[];
    /** Pre-pass and rewrite: the recipe that is drawn, or that was refused last. */
    recipe?: string | null;
    /** Its steps that do not apply, and why. */
    skipped?: string[];
    /** What the self-tests found: `kept`, `unseen`, or `broken` with the recipe and the reason. Null: the recipe needs none. */
    selfTest?: string | null;
    /** Recipes whose self-test failed. */
    failures?: { recipe: string; failure: string }[];
    /** The plan: see docs/reference/plan-json.md. */
    plan?: any;
    /** Whether it is of the program that three.js drew last. */
    isCurrent?: boolean;
    /** Pre-pass: its form. */
    form?: 'equal' | 'biased';
    /** Pre-pass and rewrite: whether it is drawn. */
    on?: boolean;
    /** The time with it as a part of that without, with the interval of 95 %. `together`: of all materials of the view. */
    measured?: {
        known: boolean;
        ratio: number;
        low: number;
        high: number;
        frames: number;
        on: boolean;
        together: boolean;
    } | null;
    /** Fragments per pixel that would be shaded without a pre-pass. */
    perPixel?: number | null;
    /** Override: the class of the pass. */
    of?: string;
    /** Override: where the normals come from. */
    normals?: string;
    [key: string]: unknown;
}
