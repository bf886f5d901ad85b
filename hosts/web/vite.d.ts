import type { PreshadeOptions, RewriteOptions } from './index.js';

export interface PluginOptions extends RewriteOptions {
    /** A refused pass, or a target that cannot express the variant, is an error of the build. */
    strict?: boolean;
    compiler?: PreshadeOptions;
}

/** Rewrites the shaders of imports with the query `?preshade=PASS`. */
export default function preshade(options?: PluginOptions): {
    name: string;
    enforce: 'pre';
    [hook: string]: any;
};
