//! The connection to a server: where it leads and what each call carries. Secrets are in no error.

#pragma once

#include <memory>
#include <string>

#include <grpcpp/grpcpp.h>

#include "covis/options.hpp"

namespace covis::detail {

/// A channel whose calls carry the token.
class Link {
  public:
    /// Throws `kInvalidUrl`, `kInvalidToken`, `kTokenInPlainText`, `kArgument`.
    Link(const std::string& url, const ConnectOptions& options);

    const std::string& url() const { return url_; }
    std::chrono::milliseconds deadline() const { return link_.deadline; }
    const std::shared_ptr<grpc::Channel>& channel() const { return channel_; }
    /// Waits until the connection stands; throws `kUnreachable`.
    void check() const;
    /// What a call carries.
    void prepare(grpc::ClientContext& context) const;

    /// Makes a call with many answers, which `on_answer` gets; throws `kRpc`.
    template <class Answer, class Service, class Question, class OnAnswer>
    void answers(std::unique_ptr<grpc::ClientReader<Answer>> (Service::*method)(grpc::ClientContext*,
                                                                                const Question&),
                 const Question& request, Timeout timeout, OnAnswer on_answer) const {
        grpc::ClientContext context;
        prepare(context);
        if (timeout) {
            context.set_deadline(std::chrono::system_clock::now() + *timeout);
        }
        Service stub(channel_);
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
        if (!status.ok()) {
            throw Error::of_request(Question::descriptor()->name(), status);
        }
    }

  private:
    std::string url_;
    LinkOptions link_;
    std::string authorization_;
    std::shared_ptr<grpc::Channel> channel_;
};

}  // namespace covis::detail
