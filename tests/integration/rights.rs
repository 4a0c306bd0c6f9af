//! Streams that are open when their right ends: a token is taken away or lowered, expires, or its key
//! goes. What was taken is answered first, and nobody else is disturbed.
//!
//! The solver pool is held, so that a stream's OPTIMIZED is outstanding when its right ends.

use covis::wire::v1;
use tonic::{Code, Status, Streaming};
use v1::ingest_request::Item;
use v1::ingest_response::Event;

use crate::common::{Stream, TestServer, bearing, camera, check_status, keyframe, occupy, run};
use crate::jwt::{Guarded, Issuer, NOW};
use crate::rpc_access::tokens_toml;

/// An ingest stream and a watch of the map "house" by one token.
struct Open {
    ingest: Stream,
    watch: Streaming<v1::WatchMapResponse>,
}

impl Open {
    async fn with(server: &TestServer, token: &str, client: &str) -> Self {
        let (ingest, _) = Stream::open_with(server, token, "house", client, 0).await;
        let map_id = "house".to_owned();
        let request = v1::WatchMapRequest { map_id, ..v1::WatchMapRequest::default() };
        let watch = server.maps().watch_map(bearing(token, request)).await.unwrap().into_inner();
        Self { ingest, watch }
    }

    /// Has two keyframes taken; the second is not optimized before the pool is let go.
    async fn put_keyframes(&mut self) {
        self.ingest.put(1, Item::Camera(camera(0))).await;
        self.ingest.put(2, Item::Keyframe(keyframe(0))).await;
        self.ingest.put(3, Item::Keyframe(keyframe(1))).await;
    }

    /// Reads the ingest stream to its end; what was taken was answered before.
    async fn ingest_end(&mut self) -> Status {
        let mut is_optimized = false;
        loop {
            match self.ingest.event().await {
                Ok(Event::Ack(ack)) => {
                    is_optimized |= ack.status() == v1::AckStatus::Optimized && ack.sequence == 3;
                }
                Ok(Event::Opened(_)) => panic!("opened twice"),
                Err(status) => {
                    assert!(is_optimized, "an ack is missing before {status}");
                    return status;
                }
            }
        }
    }

    async fn watch_end(&mut self) -> Status {
        loop {
            match self.watch.message().await {
                Ok(answer) => assert!(answer.is_some(), "the watch ended well"),
                Err(status) => return status,
            }
        }
    }

    /// Both streams go on: an item is taken, and its change is told.
    async fn goes_on(&mut self, sequence: i64) {
        let ack = self.ingest.put(sequence, Item::Camera(camera(sequence))).await;
        loop {
            let answer = self.watch.message().await.unwrap().unwrap();
            if answer.delta.unwrap().revision >= ack.revision {
                return;
            }
        }
    }
}

#[test]
fn a_token_that_is_taken_away_ends_its_streams_after_their_acks() {
    run(async {
        let all = tokens_toml(&[("a", "acme", "write"), ("b", "acme", "write")]);
        let guarded = Guarded::start(&Issuer::new("k").jwks(), Some(&all)).await;
        guarded.create("secret-of-a").await.unwrap();
        let mut a = Open::with(&guarded.server, "secret-of-a", "a").await;
        let mut b = Open::with(&guarded.server, "secret-of-b", "b").await;
        let busy = occupy(&guarded.server).await;
        a.put_keyframes().await;
        // A reload that changes nothing for a stream leaves it alone.
        guarded.server.running.reload().unwrap();
        a.goes_on(4).await;
        guarded.write("tokens.toml", &tokens_toml(&[("b", "acme", "write")]));
        guarded.server.running.reload().unwrap();
        check_status(&a.watch_end().await, Code::Unauthenticated, "UNAUTHENTICATED");
        drop(busy);
        check_status(&a.ingest_end().await, Code::Unauthenticated, "UNAUTHENTICATED");
        b.goes_on(1).await;
    });
}

#[test]
fn a_role_that_is_lowered_ends_what_it_no_longer_covers() {
    run(async {
        let all = tokens_toml(&[("a", "acme", "write")]);
        let guarded = Guarded::start(&Issuer::new("k").jwks(), Some(&all)).await;
        guarded.create("secret-of-a").await.unwrap();
        let mut a = Open::with(&guarded.server, "secret-of-a", "a").await;
        a.put_keyframes().await;
        guarded.write("tokens.toml", &tokens_toml(&[("a", "acme", "admin")]));
        guarded.server.running.reload().unwrap();
        a.goes_on(4).await;
        guarded.write("tokens.toml", &tokens_toml(&[("a", "acme", "read")]));
        guarded.server.running.reload().unwrap();
        let status = a.ingest.end().await;
        check_status(&status, Code::PermissionDenied, "ROLE_TOO_LOW");
        // The same token under another tenant is another caller.
        guarded.write("tokens.toml", &tokens_toml(&[("a", "rival", "admin")]));
        guarded.server.running.reload().unwrap();
        check_status(&a.watch_end().await, Code::Unauthenticated, "UNAUTHENTICATED");
    });
}

#[test]
fn a_signed_token_ends_its_streams_when_it_expires() {
    run(async {
        let issuer = Issuer::new("k");
        let guarded = Guarded::start(&issuer.jwks(), None).await;
        let token = issuer.token("acme", "write");
        guarded.create(&token).await.unwrap();
        let mut open = Open::with(&guarded.server, &token, "a").await;
        open.put_keyframes().await;
        guarded.time.send_replace(NOW + 359);
        open.goes_on(4).await;
        guarded.time.send_replace(NOW + 360);
        for status in [open.ingest.end().await, open.watch_end().await] {
            check_status(&status, Code::Unauthenticated, "UNAUTHENTICATED");
            assert_eq!(status.message(), "the token has expired");
        }
    });
}

#[test]
fn a_key_that_is_taken_away_ends_the_streams_of_its_tokens() {
    run(async {
        let (old, new) = (Issuer::new("k"), Issuer::new("k"));
        let guarded = Guarded::start(&old.jwks(), None).await;
        let token = old.token("acme", "write");
        guarded.create(&token).await.unwrap();
        let mut open = Open::with(&guarded.server, &token, "a").await;
        open.put_keyframes().await;
        guarded.server.running.reload().unwrap();
        open.goes_on(4).await;
        // Another key under the same name.
        guarded.write("keys.json", &new.jwks());
        guarded.server.running.reload().unwrap();
        for status in [open.ingest.end().await, open.watch_end().await] {
            check_status(&status, Code::Unauthenticated, "UNAUTHENTICATED");
            assert_eq!(status.message(), "the token is not known");
        }
    });
}
