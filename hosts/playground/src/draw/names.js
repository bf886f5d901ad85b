// The meaning of a uniform's or an attribute's name: the conventions of docs/reference/scene-values.md.

const MEANINGS = {
    viewProjection:
        'viewproj viewprojection viewprojmatrix viewprojectionmatrix projview projectionview clipfromworld worldtoclip vp',
    modelViewProjection:
        'mvp mvpmatrix modelviewproj modelviewprojection modelviewprojectionmatrix worldviewproj worldviewprojection transform',
    model: 'model modelmatrix world worldmatrix objecttoworld localtoworld worldfromlocal',
    normalMatrix: 'normalmatrix normal modelnormal inversetransposemodel',
    view: 'view viewmatrix worldtoview viewfromworld modelview modelviewmatrix',
    projection: 'projection projectionmatrix proj clipfromview',
    inverseView: 'inverseview invview viewinverse worldfromview',
    inverseProjection: 'inverseprojection invprojection invproj viewfromclip',
    inverseViewProjection: 'inverseviewprojection inverseviewproj invviewproj worldfromclip',
    inverseModel: 'inversemodel invmodel worldtoobject localfromworld',
    lightViewProjection: 'lightviewproj lightviewprojection lightspacematrix shadowmatrix',
    cameraPosition: 'cameraposition camerapos campos camera eye eyepos eyeposition viewpos viewposition',
    time: 'time seconds elapsed elapsedtime',
    lightDirection: 'lightdirection lightdir sundirection sundir tolight',
    lightPosition: 'lightposition lightpos',
    lightColor: 'lightcolor lightcolour lightradiance suncolor',
    resolution: 'resolution viewport viewportsize screensize framesize',
    near: 'near znear nearplane cameranear',
    far: 'far zfar farplane camerafar',
    aspect: 'aspect aspectratio',
};
const BY_NAME = new Map(
    Object.entries(MEANINGS).flatMap(([meaning, names]) => names.split(' ').map((name) => [name, meaning])),
);

/** Without case, underscores and the usual prefixes. */
export function normalise(name) {
    let rest = name.replace(/^_+/, '').replace(/^([uaivgm]|in)_/, '');
    rest = rest.replace(/^in(?=[A-Z])/, '').replace(/^[uai](?=[A-Z])/, '');
    return rest.replaceAll('_', '').toLowerCase();
}

/** What a variable's member means: by its name with its struct's (`camera.position`), then by its own. */
export function meaning(path) {
    const parts = path
        .replace(/\[\d+\]/g, '')
        .split('.')
        .map(normalise);
    const own = parts.at(-1);
    const bare = own.replace(/(matrix|mat)$/, '').replace(/^camera(?=.)/, '');
    const joined = parts.length > 1 ? parts.at(-2) + own : '';
    return BY_NAME.get(joined) ?? BY_NAME.get(own) ?? BY_NAME.get(bare) ?? null;
}

/** A number from 0 to 1 that a name has in every run. */
export function share(name, salt = 0) {
    let hash = 0x811c9dc5 ^ salt;
    for (let i = 0; i < name.length; i++) hash = Math.imul(hash ^ name.charCodeAt(i), 0x01000193);
    hash = Math.imul(hash ^ (hash >>> 15), 0x2c1b3c6d);
    return ((hash ^ (hash >>> 13)) >>> 0) / 2 ** 32;
}
