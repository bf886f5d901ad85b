//! A folder of this machine as a site. A page of a `file://` address may read every file of the user's; a page of this
//! site reads what is below the folder.

use std::collections::BTreeSet;
use std::fs::File;
use std::io;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use tiny_http::{Header, Response, Server};

/// Paths that are told.
const TOLD: usize = 5;

/// A server on this machine's own address. It ends when this is dropped.
pub struct Site {
    server: Arc<Server>,
    thread: Option<JoinHandle<()>>,
    root: PathBuf,
    address: SocketAddr,
    missing: Arc<Mutex<BTreeSet<String>>>,
}

impl Site {
    /// Serves what is below a folder.
    ///
    /// # Errors
    /// There is no such folder, or no free port.
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
                // The browser may have gone.
                let _ = match file(&folder, &path) {
                    Some((file, kind)) => {
                        let mut response = Response::from_file(file);
                        response.add_header(kind);
                        request.respond(response)
                    }
                    None => {
                        let mut missing = lacks.lock().unwrap_or_else(PoisonError::into_inner);
                        // Browsers ask for it by themselves.
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

    /// The address of a file below the folder. `None`: it is elsewhere.
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

    /// Files that the page asked for and that are not below the folder: the first of them.
    pub fn missing(&self) -> Vec<String> {
        let missing = self.missing.lock().unwrap_or_else(PoisonError::into_inner);
        missing.iter().cloned().collect()
    }
}

impl Drop for Site {
    fn drop(&mut self) {
        self.server.unblock();
        if let Some(thread) = self.thread.take() {
            // A panic of it was printed.
            let _ = thread.join();
        }
    }
}

/// The path of a request, decoded, without its query.
fn path(url: &str) -> String {
    let path = url.split(['?', '#']).next().unwrap_or_default();
    let path = urlencoding::decode(path).unwrap_or_default();
    path.trim_start_matches('/').to_owned()
}

/// A file below the folder, and its type. Links may not lead out of it.
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

/// The type of a file: a browser takes scripts and modules only as what they are, and sees itself what pictures are.
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
