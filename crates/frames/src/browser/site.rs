//! Serves a local folder over HTTP. A page from a `file://` address could read every file of the
//! user. A page of this site can read only files below the folder.

use std::collections::BTreeSet;
use std::fs::File;
use std::io;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use tiny_http::{Header, Response, Server};

/// How many missing paths to report.
const TOLD: usize = 5;

/// A server on the loopback address. Dropping it stops it.
pub struct Site {
    server: Arc<Server>,
    thread: Option<JoinHandle<()>>,
    root: PathBuf,
    address: SocketAddr,
    missing: Arc<Mutex<BTreeSet<String>>>,
}

impl Site {
    /// Starts to serve the files below a folder.
    ///
    /// # Errors
    /// The folder does not exist, or no port is free.
    pub fn open(root: &Path) -> io::Result<Self> {
        let root = root.canonicalize()?;
        let server = Arc::new(Server::http(("127.0.0.1", 0)).map_err(io::Error::other)?);
        let address = server.server_addr().to_ip();
        let address = address.ok_or_else(|| io::Error::other("it has no port"))?;
        let missing = Arc::new(Mutex::new(BTreeSet::new()));
        let (requests, folder, lacks) = (Arc::clone(&server), root.clone(), Arc::clone(&missing));
        let thread = std::thread::spawn(move || {
            for request in requests.incoming_requests() {
                let path = path(request.url());
                // The browser may be gone.
                let _ = match file(&folder, &path) {
                    Some((file, kind)) => {
                        let mut response = Response::from_file(file);
                        response.add_header(kind);
                        request.respond(response)
                    }
                    None => {
                        let mut missing = lacks.lock().unwrap_or_else(PoisonError::into_inner);
                        // Browsers request this one on their own.
                        if path != "favicon.ico" && missing.len() < TOLD {
                            missing.insert(path);
                        }
                        request.respond(Response::empty(404))
                    }
                };
            }
        });
        Ok(Self {
            server,
            thread: Some(thread),
            root,
            address,
            missing,
        })
    }

    /// The URL of a file. `None` if the file is not below the folder.
    pub fn address(&self, file: &Path) -> Option<String> {
        let file = file.canonicalize().ok()?;
        let below = file.strip_prefix(&self.root).ok()?;
        let parts = below
            .components()
            .map(|part| part.as_os_str().to_string_lossy());
        let parts: Vec<String> = parts
            .map(|part| urlencoding::encode(&part).into_owned())
            .collect();
        Some(format!("http://{}/{}", self.address, parts.join("/")))
    }

    /// The first paths that the page requested and that are not below the folder.
    pub fn missing(&self) -> Vec<String> {
        let missing = self.missing.lock().unwrap_or_else(PoisonError::into_inner);
        missing.iter().cloned().collect()
    }
}

impl Drop for Site {
    fn drop(&mut self) {
        self.server.unblock();
        if let Some(thread) = self.thread.take() {
            // The panic has already been printed.
            let _ = thread.join();
        }
    }
}

/// The path of a request: decoded, without query and fragment.
fn path(url: &str) -> String {
    let path = url.split(['?', '#']).next().unwrap_or_default();
    let path = urlencoding::decode(path).unwrap_or_default();
    path.trim_start_matches('/').to_owned()
}

/// Opens a file below the folder, with its content type. Refuses links that lead out of it.
fn file(root: &Path, path: &str) -> Option<(File, Header)> {
    let mut whole = root.join(path).canonicalize().ok()?;
    if whole.is_dir() {
        whole.push("index.html");
        whole = whole.canonicalize().ok()?;
    }
    if !whole.starts_with(root) || !whole.is_file() {
        return None;
    }
    let ending = whole
        .extension()
        .unwrap_or_default()
        .to_string_lossy()
        .to_lowercase();
    let header = Header::from_bytes("Content-Type", kind(&ending)).ok()?;
    Some((File::open(whole).ok()?, header))
}

/// The content type of a file. Browsers refuse scripts and modules of a wrong type, and detect
/// pictures themselves.
fn kind(ending: &str) -> &'static str {
    match ending {
        "html" | "htm" => "text/html; charset=utf-8",
        "js" | "mjs" | "cjs" => "text/javascript; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "json" | "gltf" | "map" => "application/json",
        "wasm" => "application/wasm",
        "svg" => "image/svg+xml",
        "txt" | "glsl" | "vert" | "frag" | "wgsl" => "text/plain; charset=utf-8",
        _ => "application/octet-stream",
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::fs;
    use std::io::{Read as _, Write as _};
    use std::net::TcpStream;

    fn get(site: &Site, path: &str) -> String {
        let mut stream = TcpStream::connect(site.address).unwrap();
        let request = format!("GET {path} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n");
        stream.write_all(request.as_bytes()).unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        text
    }

    #[test]
    fn only_what_is_below_the_folder_is_served() {
        let whole = tempfile::tempdir().unwrap();
        let root = whole.path().join("site");
        fs::create_dir_all(root.join("a b")).unwrap();
        fs::write(whole.path().join("secret.txt"), "secret").unwrap();
        fs::write(root.join("a b/index.html"), "<p>here</p>").unwrap();
        fs::write(root.join("module.mjs"), "export {}").unwrap();
        let site = Site::open(&root).unwrap();
        let address = site.address(&root.join("a b/index.html")).unwrap();
        assert!(address.ends_with("/a%20b/index.html"), "{address}");
        assert_eq!(site.address(&whole.path().join("secret.txt")), None);
        assert!(get(&site, "/a%20b/").contains("<p>here</p>"));
        let module = get(&site, "/module.mjs?v=1");
        assert!(
            module.contains("text/javascript") && module.contains("export {}"),
            "{module}"
        );
        let outside = [
            "/../secret.txt".to_owned(),
            "/%2e%2e/secret.txt".to_owned(),
            format!("/{}", whole.path().join("secret.txt").display()),
        ];
        for path in outside {
            let answer = get(&site, &path);
            assert!(
                answer.starts_with("HTTP/1.1 404") && !answer.contains("secret"),
                "{answer}"
            );
        }
        assert_eq!(site.missing().len(), 2, "{:?}", site.missing());
    }
}
