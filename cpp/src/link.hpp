//! The connection to a server: where it leads and what each call carries. Secrets are in no error.
//!
//! Several servers may share maps. A link that is given the URLs of some goes to the first that answers. A
//! server that does not serve a map names the one that does (MAP_OWNED_ELSEWHERE): the link then goes
//! there. When it breaks it goes back to the server that named the owner, and from there to the next of the
//! URLs that it was given. With one URL it stays there.

#pragma once

#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "covis/options.hpp"

namespace covis::detail {

/// How often a call follows from server to server before it fails.
constexpr int kMostFollowed = 4;

/// Where calls go, of all the servers that there may be; its calls carry the token. Threads may share it.
class Link {
  public:
    /// `urls` are separated by commas. Throws `kInvalidUrl`, `kInvalidToken`, `kTokenInPlainText`,
    /// `kArgument`.
    Link(const std::string& urls, const ConnectOptions& options);

    /// The address that calls go to.
    std::string url() const { return at().url; }
    std::chrono::milliseconds deadline() const { return options_.link.deadline; }
    const RetryPolicy& retry() const { return options_.link.retry; }
    std::shared_ptr<grpc::Channel> channel() const { return at().channel; }
    /// Goes to the first server to which the connection stands; throws `kUnreachable` of the first.
    void check() const;
    /// One that goes its own ways from here on, for what follows one map.
    std::shared_ptr<const Link> apart() const;
    /// Goes to the server that an error names, or, where the link broke or nobody serves the map, to the
    /// next one. Whether the error named the owner of a map, so that nothing of the call was done.
    bool follow(const Error& error) const noexcept;
    /// What a call carries; the same for all servers.
    void prepare(grpc::ClientContext& context) const;

    /// Makes a call with many answers, which `on_answer` gets; throws `kRpc`.
    template <class Answer, class Service, class Question, class OnAnswer>
    void answers(std::unique_ptr<grpc::ClientReader<Answer>> (Service::*method)(grpc::ClientContext*,
                                                                                const Question&),
                 const Question& request, Timeout timeout, OnAnswer on_answer) const {
        for (int followed = 0;; ++followed) {
            grpc::ClientContext context;
            prepare(context);
            if (timeout) {
                context.set_deadline(std::chrono::system_clock::now() + *timeout);
            }
            Service stub(channel());
            const auto reader = (stub.*method)(&context, request);
            Answer answer;
            try {
                while (reader->Read(&answer)) {
                    on_answer(answer);
                }
            } catch (...) {
                context.TryCancel();
                reader->Finish();
                throw;
            }
            const auto status = reader->Finish();
            if (status.ok()) {
                return;
            }
            // Where another server has the map there was no answer yet.
            const Error error = Error::of_request(Question::descriptor()->name(), status);
            if (!follow(error) || followed == kMostFollowed) {
                throw Error(error);
            }
        }
    }

  private:
    struct Server {
        std::string url;
        std::shared_ptr<grpc::Channel> channel;
    };

    Server open(const std::string& url) const;
    Server at() const;
    bool go_to(const std::string& url, std::size_t place) const noexcept;

    ConnectOptions options_;
    std::string authorization_;
    std::vector<std::string> given_;
    mutable std::mutex mutex_;
    mutable Server at_;
    /// The place of the URL that was given and used last.
    mutable std::size_t place_ = 0;
};

}  // namespace covis::detail
