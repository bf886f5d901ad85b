import type {
    AgreeOptions,
    Agreement,
    ExplainOptions,
    Explained,
    OutputsOptions,
    PassInfo,
    PreshadeOptions,
    RewriteOptions,
    Sources,
    Variant,
} from './index.js';

export { PreshadeError } from './index.js';

/** The compiler on the caller's thread. */
export declare class PreshadeSync {
    constructor(options?: Pick<PreshadeOptions, 'wasm'>);
    /** Bytes of the compiler's memory. */
    readonly memory: number;
    rewrite(sources: Sources, options?: RewriteOptions): Variant;
    explain(sources: Sources, options?: ExplainOptions): Explained;
    outputs(sources: Sources, options: OutputsOptions): Variant;
    agree(first: Sources, second: Sources, options: AgreeOptions): Agreement;
    passes(options?: { name?: string }): PassInfo[];
}

export declare function rewrite(sources: Sources, options?: RewriteOptions): Variant;
export declare function explain(sources: Sources, options?: ExplainOptions): Explained;
export declare function outputs(sources: Sources, options: OutputsOptions): Variant;
export declare function agree(first: Sources, second: Sources, options: AgreeOptions): Agreement;
export declare function passes(options?: { name?: string }): PassInfo[];
