// The repository on GitHub that this page comes from: of the build, or of the address of GitHub's own pages.

const [, owner] = /^([\w-]+)\.github\.io$/.exec(location.hostname) ?? [];
const [, name] = /^\/([\w.-]+)\//.exec(location.pathname) ?? [];
const found = __REPOSITORY__ || (owner && name ? `${owner}/${name}` : '');

/** `owner/name`, or empty where it is not known. */
export const REPOSITORY = /^[\w.-]+\/[\w.-]+$/.test(found) ? found : '';
