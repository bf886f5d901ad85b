//! A client of DevTools' protocol: calls, their results, and events between them.

use std::io::ErrorKind;
use std::net::{Ipv4Addr, TcpStream};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tungstenite::protocol::WebSocket;
use tungstenite::{Message, client};

use super::BrowserError;

/// Timeout of one read from the socket.
const STEP: Duration = Duration::from_millis(100);

/// A connection to the browser, with a session once a page is open.
pub(crate) struct Client {
    socket: WebSocket<TcpStream>,
    calls: u64,
    session: Option<String>,
    /// A call fails after this time without a message.
    pub patience: Duration,
}

/// Receives the page's events: method name and parameters.
pub(crate) type Events<'a> = &'a mut dyn FnMut(&str, &Value);

impl Client {
    /// Connects to the browser that listens at `port`.
    pub fn connect(port: u16, path: &str, patience: Duration) -> Result<Self, BrowserError> {
        let lost = |e: &dyn std::error::Error| BrowserError::Lost(e.to_string());
        let stream = TcpStream::connect((Ipv4Addr::LOCALHOST, port)).map_err(|e| lost(&e))?;
        stream
            .set_read_timeout(Some(patience))
            .map_err(|e| lost(&e))?;
        let url = format!("ws://127.0.0.1:{port}{path}");
        let (socket, _) = client(url, stream).map_err(|e| lost(&e))?;
        socket
            .get_ref()
            .set_read_timeout(Some(STEP))
            .map_err(|e| lost(&e))?;
        Ok(Self {
            socket,
            calls: 0,
            session: None,
            patience,
        })
    }

    /// Opens a page. Later calls and events belong to it.
    pub fn open_page(&mut self) -> Result<(), BrowserError> {
        let nothing: Events = &mut |_, _| {};
        let target = self.call(
            "Target.createTarget",
            json!({ "url": "about:blank" }),
            nothing,
        )?;
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let session = self.call("Target.attachToTarget", attach, nothing)?;
        self.session = session["sessionId"].as_str().map(str::to_owned);
        Ok(())
    }

    /// Calls a method and waits for its result. Passes events to `events` meanwhile.
    pub fn call(
        &mut self,
        method: &str,
        parameters: Value,
        events: Events,
    ) -> Result<Value, BrowserError> {
        self.calls += 1;
        let id = self.calls;
        let mut message = json!({ "id": id, "method": method, "params": parameters });
        if let Some(session) = &self.session {
            message["sessionId"] = json!(session);
        }
        self.socket
            .send(Message::text(message.to_string()))
            .map_err(|e| BrowserError::Lost(e.to_string()))?;
        let mut heard = Instant::now();
        loop {
            let Some(mut message) = self.read()? else {
                if heard.elapsed() > self.patience {
                    return Err(BrowserError::Silent(self.patience));
                }
                continue;
            };
            heard = Instant::now();
            if let Some(method) = message["method"].as_str() {
                events(method, &message["params"]);
            } else if message["id"] == json!(id) {
                return match message.get("error") {
                    None => Ok(message["result"].take()),
                    Some(error) => Err(BrowserError::Protocol {
                        method: method.to_owned(),
                        message: error["message"].as_str().unwrap_or_default().to_owned(),
                    }),
                };
            }
        }
    }

    /// Receives events until `events` returns true (result: true) or `time` is over.
    pub fn listen(
        &mut self,
        time: Duration,
        events: &mut dyn FnMut(&str, &Value) -> bool,
    ) -> Result<bool, BrowserError> {
        let end = Instant::now() + time;
        while Instant::now() < end {
            if let Some(message) = self.read()?
                && let Some(method) = message["method"].as_str()
                && events(method, &message["params"])
            {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The next message, if one arrives within [`STEP`].
    fn read(&mut self) -> Result<Option<Value>, BrowserError> {
        match self.socket.read() {
            Ok(Message::Text(text)) => serde_json::from_str(&text)
                .map(Some)
                .map_err(|e| BrowserError::Lost(e.to_string())),
            Ok(_) => Ok(None),
            Err(tungstenite::Error::Io(e))
                if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) =>
            {
                Ok(None)
            }
            Err(e) => Err(BrowserError::Lost(e.to_string())),
        }
    }
}
