// In a page: compiles and links `programs`, [[context, vertex text, fragment text], ..], with WebGL. The page's text becomes one verdict each: null, an error, or {lacks: EXTENSION} where this
// browser's WebGL has not an extension that the text requires.
function judge(programs) {
    const contexts = {};
    const context = (kind) => {
        const gl = document.createElement('canvas').getContext(kind);
        if (!gl) throw new Error(`there is no ${kind}`);
        for (const name of gl.getSupportedExtensions()) gl.getExtension(name);
        return gl;
    };
    // WebGL's names of GLSL's extensions. Others are WebGL's without the prefix.
    const names = { GL_EXT_blend_func_extended: 'WEBGL_blend_func_extended' };
    const lacks = (gl, texts) => {
        const required = [...texts.join('\n').matchAll(/^#extension (\w+)/gm)].map(([, name]) => name);
        const known = ['WEBGL_blend_func_extended', 'OES_standard_derivatives', 'EXT_frag_depth', 'EXT_shader_texture_lod'];
        const wanted = required.map((name) => names[name] ?? name.replace(/^GL_/, ''));
        return wanted.find((name) => known.includes(name) && !gl.getSupportedExtensions().includes(name));
    };
    const verdict = ([kind, ...texts]) => {
        const gl = (contexts[kind] ??= context(kind));
        const missing = lacks(gl, texts);
        if (missing) return { lacks: missing };
        const program = gl.createProgram();
        const shaders = [gl.VERTEX_SHADER, gl.FRAGMENT_SHADER].map((type, i) => {
            const shader = gl.createShader(type);
            gl.shaderSource(shader, texts[i]);
            gl.compileShader(shader);
            gl.attachShader(program, shader);
            return shader;
        });
        gl.linkProgram(program);
        const linked = gl.getProgramParameter(program, gl.LINK_STATUS);
        const logs = [...shaders.map((shader) => gl.getShaderInfoLog(shader)), gl.getProgramInfoLog(program)];
        shaders.forEach((shader) => gl.deleteShader(shader));
        gl.deleteProgram(program);
        if (gl.isContextLost()) return 'the context is lost';
        return linked ? null : logs.join('\n') || 'refused without a word';
    };
    return programs.map(verdict);
}
