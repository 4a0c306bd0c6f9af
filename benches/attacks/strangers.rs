//! Those who have no token: connections that say nothing, messages that are never finished, wrong tokens.
//!
//! Half of a message cannot be sent by a gRPC library, so that the frames are written here (RFC 9113).

use std::time::Duration;

use covis::client::{Client, Credentials, Token};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

use crate::Target;

/// Connects as often as it is told to and says nothing; a connection that is closed is made again.
pub(crate) async fn idle(target: Target) {
    let Some(address) = target.url.strip_prefix("http://").map(str::to_owned) else { return };
    let mut held = tokio::task::JoinSet::new();
    loop {
        while held.len() < target.strangers {
            match TcpStream::connect(&address).await {
                Ok(mut stream) => {
                    target.tally.answer();
                    held.spawn(async move {
                        let mut said = [0; 64];
                        while matches!(stream.read(&mut said).await, Ok(1..)) {}
                    });
                }
                Err(error) => {
                    target.tally.refuse(&error.to_string());
                    tokio::time::sleep(Duration::from_millis(100)).await;
                }
            }
        }
        let _closed = held.join_next().await;
        target.tally.refuse("closed");
        // Those who are turned away do not come back faster than people would.
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
}

/// Calls with tokens that nobody has.
pub(crate) async fn wrong_tokens(target: Target) {
    let credentials =
        Credentials { token: Some(Token::new("a-token-of-nobody")), ..Credentials::default() };
    let Ok(client) = Client::connect_with(&target.url, &credentials).await else { return };
    loop {
        match client.list_maps().await {
            Ok(_) => target.tally.answer(),
            Err(error) => target.tally.refuse(&error.to_string()),
        }
    }
}

/// Bytes that each message announces, and streams that a connection holds.
const ANNOUNCED: u32 = 4 << 20;
const STREAMS: u32 = 64;

/// Messages to Health of which the end is never sent.
pub(crate) async fn half_sent(target: Target) {
    let Some(address) = target.url.strip_prefix("http://").map(str::to_owned) else { return };
    loop {
        let ended = send_halves(&address).await;
        target.tally.refuse(&ended.map_or_else(|e| e.to_string(), |()| "closed".to_owned()));
        tokio::time::sleep(Duration::from_millis(200)).await;
    }
}

async fn send_halves(address: &str) -> std::io::Result<()> {
    let stream = TcpStream::connect(address).await?;
    let (mut from, mut to) = stream.into_split();
    to.write_all(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n").await?;
    to.write_all(&frame(4, 0, 0, &[])).await?;
    // A window for each stream, kept by what the server says: 65,535 bytes until then.
    let mut windows = vec![65_535_i64; STREAMS as usize + 1];
    let mut left = vec![i64::from(ANNOUNCED) * 9 / 10; STREAMS as usize + 1];
    let mut initial = 65_535_i64;
    for index in 1..=STREAMS {
        let stream = 2 * index - 1;
        to.write_all(&frame(1, 4, stream, &head(address))).await?;
        let mut data = vec![0];
        data.extend_from_slice(&ANNOUNCED.to_be_bytes());
        // Field 1 of the request, a string that is as long as the message.
        data.extend_from_slice(&[0x0a, 0xfa, 0xff, 0xff, 0x01]);
        to.write_all(&frame(0, 0, stream, &data)).await?;
        windows[index as usize] -= data.len() as i64;
        windows[0] -= data.len() as i64;
    }
    let mut read = Vec::new();
    loop {
        for index in 1..=STREAMS as usize {
            let most = windows[0].min(windows[index]).min(left[index]).min(16_384);
            if most > 0 {
                let data = vec![b'a'; most as usize];
                to.write_all(&frame(0, 0, 2 * index as u32 - 1, &data)).await?;
                windows[0] -= most;
                windows[index] -= most;
                left[index] -= most;
            }
        }
        let can_send = windows[0] > 0 && (1..windows.len()).any(|i| windows[i].min(left[i]) > 0);
        let wait = if can_send { Duration::ZERO } else { Duration::from_secs(3600) };
        match tokio::time::timeout(wait, from.read_buf(&mut read)).await {
            Ok(Ok(0)) => return Ok(()),
            Ok(Ok(_)) => {}
            Ok(Err(error)) => return Err(error),
            Err(_more_to_send) => continue,
        }
        while let Some((kind, flags, stream, length)) = announced(&read) {
            let payload = read[9..9 + length].to_vec();
            read.drain(..9 + length);
            match kind {
                4 if flags & 1 == 0 => {
                    for setting in payload.chunks_exact(6) {
                        if setting[..2] == [0, 4] {
                            let new = i64::from(number(&setting[2..]));
                            windows[1..].iter_mut().for_each(|window| *window += new - initial);
                            initial = new;
                        }
                    }
                    to.write_all(&frame(4, 1, 0, &[])).await?;
                }
                6 if flags & 1 == 0 => to.write_all(&frame(6, 1, 0, &payload)).await?,
                7 => return Ok(()),
                8 => {
                    let index = if stream == 0 { 0 } else { stream as usize / 2 + 1 };
                    windows[index] += i64::from(number(&payload));
                }
                _ => {}
            }
        }
    }
}

/// Kind, flags, stream and length of the first frame, where it is whole.
fn announced(read: &[u8]) -> Option<(u8, u8, u32, usize)> {
    let head = read.get(..9)?;
    let length = number(&[0, head[0], head[1], head[2]]) as usize;
    (read.len() >= 9 + length).then(|| (head[3], head[4], number(&head[5..9]), length))
}

fn number(bytes: &[u8]) -> u32 {
    bytes.iter().take(4).fold(0, |number, &byte| number << 8 | u32::from(byte))
}

fn frame(kind: u8, flags: u8, stream: u32, payload: &[u8]) -> Vec<u8> {
    let mut frame = (payload.len() as u32).to_be_bytes()[1..].to_vec();
    frame.extend_from_slice(&[kind, flags]);
    frame.extend_from_slice(&stream.to_be_bytes());
    frame.extend_from_slice(payload);
    frame
}

/// The headers of a call to Health, each a literal that is not indexed (RFC 7541, 6.2.2).
fn head(address: &str) -> Vec<u8> {
    let mut block = Vec::new();
    for (name, value) in [
        (":method", "POST"),
        (":scheme", "http"),
        (":path", "/grpc.health.v1.Health/Check"),
        (":authority", address),
        ("content-type", "application/grpc"),
        ("te", "trailers"),
    ] {
        block.push(0);
        for text in [name, value] {
            block.push(text.len() as u8);
            block.extend_from_slice(text.as_bytes());
        }
    }
    block
}
