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
     * `scene` is what you give to `renderer.render`. The same scene has the same `Part`, with the options of the first call,
     * until you dispose of it.
     */
    shadows(scene: Object3D, options?: ShadowOptions): Part;
    /**
     * Normals and depth of the real geometry in a pass that overrides materials: an object with `render`. With a
     * `WebGPURenderer` a scene that has an `overrideMaterial`, or a `PassNode` of one. Returns the pass. A second call for
     * the same pass replaces the first. `false` undoes it, and so do `dispose()` and, with a `WebGLRenderer`,
     * `pass.dispose()`.
     */
    override<Pass extends object>(pass: Pass, options?: OverrideOptions | false): Pass;
    /**
     * A depth pre-pass for each material for which it pays on this device. With a `WebGPURenderer` a second call for a scene
     * throws, until you dispose of the first.
     */
    prepass(scene: Scene, options?: PrepassOptions): Prepass;
    /** Each opaque material drawn by any recipe of preshade's passes. With a `WebGPURenderer` it throws. */
    rewrite(scene: Scene, options: RewriteOptions): Rewrite;
    /** Velocities of the real geometry. With a `WebGPURenderer` the same scene has the same, as with `shadows`. */
    velocity(scene: Scene, options?: VelocityOptions): Velocity;
    /**
     * The texts that three.js made of a material: GLSL, or WGSL of a `WebGPURenderer`. With `object` those for it, else
     * those of the last draw. It is needed where a package draws the object with a material derived from yours. Null before
     * three.js has drawn it.
     */
    text(material: Material, object?: Object3D): { vertex: string; fragment: string } | null;
    report(): Row[];
    /**
     * Resolves when no variant is being made and no program is being linked, of all that was drawn so far. Self-tests and
     * measurements of pre-passes and recipes need more frames: see their `isSettled`.
     */
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
    /**
     * Whether to draw over `customDepthMaterial` and `customDistanceMaterial` of objects: false. A `WebGPURenderer` of
     * three.js does not know these materials, so it makes no difference there.
     */
    replaceCustom?: boolean;
}

/**
 * Where the normals of a pass come from. `program`: the normal that your shader computes. `faces`: that of the face, from
 * derivatives of the position. Another text: the value of that name in your fragment stage.
 */
export type Normals = 'program' | 'faces' | (string & {});

export interface OverrideOptions {
    /** What reports call the pass. By default its own name, else the name of its class. */
    name?: string;
    /**
     * `WebGLRenderer` only. A function is asked once for each material. By default the normal of the program, and where that
     * has none, that of the face.
     */
    normals?: Normals | ((material: Material) => Normals | null | undefined);
}

/** Passes in order, as preshade's `rewrite` takes them: `['hoist', 'depth-prepass']`. */
export type Recipe = string | string[];

/** What `prepass` and `rewrite` have in common. */
export interface PlanOptions {
    /** Whether to measure first, and to draw by a plan only where it pays: false. Without, each material is drawn by its plan. */
    measure?: boolean | MeasureOptions;
    /** The materials it is for; by default all. */
    materials?: Material[] | ((material: Material) => boolean);
    /** Whether what was measured is remembered in localStorage: true. A `WebGPURenderer` remembers nothing: there `true` throws. */
    remember?: boolean;
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
    /** By which factor the fragments per pixel have to change until it is measured again: 1.3. `WebGPURenderer`: the draws. */
    factor?: number;
    /**
     * After how many seconds it is looked at whether what is drawn still pays; then after twice as many each time, up to ten
     * minutes: 10.
     */
    again?: number;
    /** By default `timer-query`, where the driver has it. `WebGPURenderer`: its timestamps, else until the queue is done. */
    method?: 'timer-query' | 'fence';
}

export interface Rewrite extends Part {
    /**
     * Whether nothing of what was drawn so far is compiled, tested or measured; a look at what was measured (`again`) is not
     * waited for. Tests and measurements need frames.
     */
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
    /**
     * `WebGPURenderer`: whether the velocities are drawn with each picture of the scene: true. Otherwise you call `render`
     * once in each frame. A `WebGLRenderer` always draws them.
     */
    automatic?: boolean;
}

export interface Part {
    /** Switches it off and on. While it is off, rows of what it would draw have the state `off`. */
    enabled: boolean;
    report(): Row[];
    dispose(): void;
}

export interface Velocity extends Part {
    /** Two half floats, as large as what the scene is drawn into. The same object for good. */
    readonly texture: Texture;
    /** `WebGPURenderer`: the texture as a node, for `traa` and `motionBlur`. */
    readonly node?: object;
    /** `WebGPURenderer`: draws the velocities of a frame, where `automatic` is false. Each call is a frame. `size`: in pixels. */
    render?(camera: Camera, size?: { x: number; y: number }): void;
}

/**
 * What is done for a material in one pass. A material with several programs may have several rows. All have all fields.
 * Those after `uuid` are not enumerable: `console.table`, JSON and copies leave them out.
 */
export interface Row {
    pass: 'shadow' | 'override' | 'prepass' | 'rewrite' | 'velocity' | 'all';
    /** Override: the pass. */
    of: string | null;
    /** The name of the material, else its type. */
    material: string;
    /**
     * `done`: drawn by preshade. `same`: three.js does the same by itself. `pending`: its variant is being made. `waiting`:
     * three.js has not drawn it yet, or nothing of it was in view of the self-test. `measuring`: frames with and without it
     * are timed. `off`: measured, and not drawn. `refused`: `reason` says why. `failed`: the text or the program has an
     * error. `unsupported`: nothing can be done for this renderer.
     */
    state: 'done' | 'same' | 'pending' | 'waiting' | 'measuring' | 'off' | 'refused' | 'failed' | 'unsupported';
    reason: string | null;
    /** What would make it possible. */
    remedy: string | null;
    /** The README lists those of this package; others are the compiler's. */
    code: string | null;
    /** Milliseconds that the compiler took, without the wait for other variants; 0 if the variant was in IndexedDB. */
    ms: number;
    /**
     * What tells variants of one pass apart. Shadows: `flat`, or `cube` for a point light. Override: the material of the
     * pass. Velocities: how the camera is shifted.
     */
    mode: string | null;
    /** Pre-pass and rewrite: the recipe that is drawn, or that was refused last. */
    recipe: string | null;
    /** Pre-pass: `equal` or `biased`. Shadows of a `WebGPURenderer`: `whole`, if the whole program is drawn, else `sliced`. */
    form: 'equal' | 'biased' | 'sliced' | 'whole' | null;
    /** What the self-tests found: `kept`, `unseen`, or `broken` with the recipe and the reason. Null: the recipe needs none. */
    selfTest: string | null;
    /** The time of frames with it as a part of that without. */
    ratio: number | null;
    /** Fragments per pixel that would be shaded without a pre-pass. */
    perPixel: number | null;
    /** Override: where the normals come from. */
    normals: string | null;
    /** Override: that the shader moves vertices and leaves their normals as they were. */
    note: string | null;
    /** Whether it is of the program that three.js drew last. */
    isCurrent: boolean;
    uuid: string;

    /** `ratio` with its interval of 95 %. `together`: of all materials of the view. */
    readonly measured: {
        known: boolean;
        ratio: number;
        low: number;
        high: number;
        frames: number;
        on: boolean;
        together: boolean;
    } | null;
    /** What timed the frames. */
    readonly method: string | null;
    /** The plan: see docs/reference/plan-json.md. */
    readonly plan: any;
    /** Steps of the recipe that do not apply, and why. */
    readonly skipped: string[];
    /** Recipes whose self-test failed, or whose text the driver refused. */
    readonly failures: { recipe: string; failure: string }[];
    /** Shadows: what was left out of the author's discards, because it depends on the viewer. */
    readonly left_out: any[];
    /**
     * If the driver refused a text that preshade wrote: the lines that it names, with their numbers, for a report to
     * preshade.
     */
    readonly rendered: string | null;
}
