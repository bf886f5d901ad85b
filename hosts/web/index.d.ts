/** A place in the author's source. */
export interface Place {
    file: string;
    /** From 1. */
    line: number;
    /** In characters, from 1. */
    column: number;
    /** Bytes of the file. */
    range: { start: number; end: number };
}

/** An error in a shader or in a request. */
export declare class PreshadeError extends Error {
    /**
     * The code of the native program's messages (`preshade --explain CODE`): `parse`, `invalid`, `no-entry-point`, ..
     * Or `usage`: the request is wrong; `too-deep`: a limit, or the engine's stack, is exceeded; `panic`: a bug;
     * `timeout`, `worker`, `disposed`: the worker.
     */
    readonly code: string;
    readonly place: Place | null;
    /** Hints. */
    readonly notes: string[];
    /** The whole message with the author's line, as a terminal shows it. */
    readonly rendered: string;
}

/** A file of a shader. Without `language` and `stage`, the ending of the name says them. */
export interface Source {
    name: string;
    text: string;
    language?: 'wgsl' | 'glsl';
    stage?: 'vertex' | 'fragment';
}

/** WGSL; or GLSL's two stages; or texts by file name; or a list of files. */
export type Sources = string | { vertex: string; fragment: string } | Record<string, string> | Source[];

/** Texts by path, relative to what the sources' names are relative to. */
export type Files = Record<string, string> | Map<string, string>;

export type Target = 'wgsl' | 'glsl' | 'glsl-vulkan' | 'glsl-es' | 'glsl-es-100' | 'glsl-tess' | 'glsl-vulkan-tess';

/** A pass with its parameters, as on the command line: `early-discard:budget=0.02`. */
export type Pass = string;

/** A step of a recipe, as in `plan.json`. */
export interface Step {
    pass: string;
    params?: Record<string, unknown>;
    site?: unknown;
}

export interface ShaderOptions {
    /** Language of sources whose names do not say it. */
    language?: 'wgsl' | 'glsl';
    /** Name of the material; by default its file's. */
    name?: string;
    /** Entry points, where there are several. */
    vertex?: string;
    fragment?: string;
    /** Definitions of GLSL's preprocessor: `['A', 'B=2']`, or an object. */
    define?: string[] | Record<string, string | number | boolean | undefined>;
    /** Folders, among the paths of `files`, to search for `#include`. */
    include?: string | string[];
    /** What `#include` finds. */
    files?: Files;
    /** Depth range of the shader's clip space; by default OpenGL's for GLSL. */
    clip?: 'zero-to-one' | 'minus-one-to-one';
    /** As of `--limits`: `strict`, or `source-bytes=1M`. */
    limits?: string;
    /** The whole pipeline state, as in the `[materials.state]` of a scene file. The options below override it. */
    state?: Record<string, unknown>;
    depthCompare?: 'never' | 'less' | 'equal' | 'less-equal' | 'greater' | 'not-equal' | 'greater-equal' | 'always';
    depthFormat?: 'depth16unorm' | 'depth24plus' | 'depth24plus-stencil8' | 'depth32float' | 'depth32float-stencil8';
    reversedZ?: boolean;
    noDepthWrite?: boolean;
    blend?: 'none' | 'alpha' | 'add';
    cull?: 'none' | 'front' | 'back';
    topology?: 'point-list' | 'line-list' | 'line-strip' | 'triangle-list' | 'triangle-strip';
    samples?: 1 | 4;
    alphaToCoverage?: boolean;
}

export interface RewriteOptions extends ShaderOptions {
    /** Passes, in order; or a recipe. */
    pass?: Pass | Pass[] | Step[];
    /** By default `wgsl`, of GLSL as well, as on the command line: for WebGL give `glsl-es`. */
    emit?: Target | Target[];
    /** Holds the variant against the original, by proof and on inputs. A broken variant has no files. */
    validate?: boolean;
}

/** A skipped step. */
export interface Refusal {
    pass: string;
    code: string;
    reason: string;
    /** What would make the step legal. */
    remedy: string;
    place: Place | null;
    /** The whole message with the author's line. */
    rendered?: string;
}

export interface Variant {
    material: string;
    /** The applied steps; empty if every step was refused, and the files are then the original's. */
    recipe: string;
    /** What the variant promises: see docs/reference/plan-json.md. */
    contract: unknown;
    refusals: Refusal[];
    notes: string[];
    /** Shaders and `plan.json`, as the native program writes them. */
    files: { name: string; text: string }[];
    /** The content of `plan.json`: pipeline state and the files of each pass. `null` without files. */
    plan: any;
    /** Targets that cannot express the variant. */
    errors: { code: string; message: string }[];
    /** What the native program says on stderr. */
    messages: string[];
    /** Names of the files that were read. */
    read: string[];
    validation?: unknown[];
}

export interface ExplainOptions extends ShaderOptions {
    /** Explain these, each after those before it; by default every pass on its own. */
    pass?: Pass | Pass[] | Step[];
}

export interface Explained {
    material: string;
    stages: { stage: string; entry_point: string; cost: number; expressions: number; effects: string[] }[];
    passes: {
        pass: string;
        summary: string;
        hurts: string;
        source: string;
        /** The change, at most one. */
        sites: { what: string; [key: string]: unknown }[];
        saved?: { stage: string; ops: number; of: number };
        within_budget?: unknown;
        refusals: Refusal[];
        left?: unknown[];
    }[];
    switches?: unknown[];
    read: string[];
}

export interface OutputsOptions extends Omit<RewriteOptions, 'pass'> {
    /** `depth`, `shadow`, `distance`, `normal`, `velocity`, `id`, or a value of the fragment stage. */
    write: string | string[];
    /** The other parameters of the pass `outputs`: `{ view: 'drop' }`. */
    parameters?: Record<string, string | number | boolean>;
}

export type Relation = 'same' | 'prepass' | 'shadow' | 'position' | 'discard' | 'velocity' | 'normal';

export interface AgreeOptions extends ShaderOptions {
    as: Relation;
    /** Options of the second program. Without them it has those of the first, but entry points and name. */
    with?: ShaderOptions;
    /** The second's variables, members and attributes, and the first's that they hold. */
    map?: string[] | Record<string, string>;
    normal?: string;
    /** Classes of findings that break the relation, or `all`, or `none`. */
    failOn?: string | string[];
    /** Inputs to try for each promise without a proof: 480. */
    inputs?: number;
}

export interface Agreement {
    agrees: boolean;
    /** Whether nothing broke, but a part could not be evaluated. */
    isPartial: boolean;
    name: string;
    relation: Relation;
    promises: { promise: string; outcome: unknown }[];
    /** The findings: class, sentence, lines of both authors. */
    judged: { class: string; words: string; breaks: boolean; [key: string]: unknown }[];
    notes: string[];
    read: string[];
    [key: string]: unknown;
}

/** A dataflow graph: values, writes and branches of the main pass, and what depends on what. */
export interface Graph {
    schema: string;
    functions: { name: string; stage?: string; cost: number; effects: string[] }[];
    nodes: {
        function: string;
        kind: 'input' | 'expression' | 'statement' | 'initial' | 'version' | 'phi' | 'output';
        text: string;
        /** The author's name for it. */
        name?: string;
        /** `file:line`. */
        line?: string;
        /** How often the value changes: `const`, `draw`, `instance`, `vertex`, `flat`, `linear`, `perspective`, .. */
        rate: string;
        stages: 'any' | 'vertex' | 'fragment' | 'none';
        /** Static cost of evaluating it once, and how often it runs per run of its function. */
        cost: number;
        times: number;
        effects?: string[];
    }[];
    /** From a node to one that depends on it, by index. */
    edges: { from: number; to: number; kind: 'data' | 'control' | 'memory' | 'call' }[];
    read: string[];
}

export interface PassInfo {
    name: string;
    summary: string;
    when: string;
    hurts: string;
    source: string;
    parameters: { name: string; what: string; [key: string]: unknown }[];
}

export interface PreshadeOptions {
    /** Where `preshade.wasm` is, or the module; by default beside this file. */
    wasm?: string | URL | ArrayBuffer | Uint8Array | WebAssembly.Module;
    /** Where `preshade-full.wasm` is, which `agree` and `validate` load. */
    full?: string | URL | ArrayBuffer | Uint8Array | WebAssembly.Module;
    /** Milliseconds after which a call fails with the code `timeout`, and the worker is replaced. */
    timeout?: number;
}

/** A compiler in a worker of its own. It starts with the first call. */
export declare class Preshade {
    constructor(options?: PreshadeOptions);
    rewrite(sources: Sources, options?: RewriteOptions): Promise<Variant>;
    explain(sources: Sources, options?: ExplainOptions): Promise<Explained>;
    outputs(sources: Sources, options: OutputsOptions): Promise<Variant>;
    agree(first: Sources, second: Sources, options: AgreeOptions): Promise<Agreement>;
    graph(sources: Sources, options?: ShaderOptions): Promise<Graph>;
    passes(options?: { name?: string }): Promise<PassInfo[]>;
    /** Starts the worker and compiles the module. */
    ready(): Promise<void>;
    /** Ends the worker. Calls without an answer fail. */
    dispose(): void;
}

export declare function rewrite(sources: Sources, options?: RewriteOptions): Promise<Variant>;
export declare function explain(sources: Sources, options?: ExplainOptions): Promise<Explained>;
export declare function outputs(sources: Sources, options: OutputsOptions): Promise<Variant>;
export declare function agree(first: Sources, second: Sources, options: AgreeOptions): Promise<Agreement>;
export declare function graph(sources: Sources, options?: ShaderOptions): Promise<Graph>;
export declare function passes(options?: { name?: string }): Promise<PassInfo[]>;
