import type {
    AgreeOptions,
    Agreement,
    ExplainOptions,
    Explained,
    Graph,
    OutputsOptions,
    PassInfo,
    PreshadeOptions,
    RewriteOptions,
    ShaderOptions,
    Sources,
    Variant,
} from './index.js';

export { PreshadeError } from './index.js';

/** The compiler on the caller's thread. */
export declare class PreshadeSync {
    constructor(options?: Pick<PreshadeOptions, 'wasm' | 'full'>);
    /** Bytes of the compiler's memory. */
    readonly memory: number;
    rewrite(sources: Sources, options?: RewriteOptions): Variant;
    explain(sources: Sources, options?: ExplainOptions): Explained;
    outputs(sources: Sources, options: OutputsOptions): Variant;
    agree(first: Sources, second: Sources, options: AgreeOptions): Agreement;
    graph(sources: Sources, options?: ShaderOptions): Graph;
    passes(options?: { name?: string }): PassInfo[];
}

export declare function rewrite(sources: Sources, options?: RewriteOptions): Variant;
export declare function explain(sources: Sources, options?: ExplainOptions): Explained;
export declare function outputs(sources: Sources, options: OutputsOptions): Variant;
export declare function agree(first: Sources, second: Sources, options: AgreeOptions): Agreement;
export declare function graph(sources: Sources, options?: ShaderOptions): Graph;
export declare function passes(options?: { name?: string }): PassInfo[];
