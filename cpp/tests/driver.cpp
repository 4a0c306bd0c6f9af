//! What the tests drive: reads a command a line, answers each with a line of JSON. One process holds
//! one connection, and at most one session and one watch. Nothing is decided here: `client.py` beside
//! it makes the commands from the calls of the scenarios.

#include <cstdio>
#include <iostream>
#include <mutex>
#include <optional>
#include <sstream>
#include <string>

#include "covis/covis.hpp"

namespace {

using std::chrono::milliseconds;

/// A JSON value that is written at once.
class Json {
  public:
    Json() { text_.precision(17); }
    template <class Number>
    Json& number(const char* name, Number value) {
        key(name) << value;
        return *this;
    }
    Json& string(const char* name, const std::string& value) {
        key(name);
        quote(value);
        return *this;
    }
    template <class Items, class Write>
    Json& list(const char* name, const Items& items, Write write) {
        key(name) << '[';
        const char* separator = "";
        for (const auto& item : items) {
            text_ << separator;
            write(*this, item);
            separator = ",";
        }
        text_ << ']';
        return *this;
    }
    void quote(const std::string& value) {
        text_ << '"';
        for (const char c : value) {
            if (c == '"' || c == '\\') {
                text_ << '\\' << c;
            } else {
                text_ << (static_cast<unsigned char>(c) < 0x20 ? ' ' : c);
            }
        }
        text_ << '"';
    }
    std::ostringstream& text() { return text_; }
    std::string done() { return "{" + text_.str() + "}"; }

  private:
    std::ostringstream& key(const char* name) {
        text_ << (text_.tellp() > 0 ? "," : "") << '"' << name << "\":";
        return text_;
    }
    std::ostringstream text_;
};

void write_pose(std::ostringstream& text, const covis::Pose& pose) {
    for (const double part : pose.translation) {
        text << part << ',';
    }
    const auto& q = pose.rotation;
    text << q[0] << ',' << q[1] << ',' << q[2] << ',' << q[3];
}

void write_item(Json& json, const covis::RejectedItem& item) {
    json.text() << "{\"sequence\":" << item.sequence << ",\"violations\":[";
    const char* separator = "";
    for (const auto& one : item.violations) {
        json.text() << separator << '[';
        json.quote(one.field);
        json.text() << ',';
        json.quote(one.description);
        json.text() << ',';
        json.quote(one.reason);
        json.text() << ']';
        separator = ",";
    }
    json.text() << "]}";
}

std::string failed(const covis::Error& error) {
    Json json;
    json.number("error", static_cast<int>(error.kind())).number("code", static_cast<int>(error.code()));
    json.number("attempts", error.attempts()).string("text", error.what());
    json.string("cause", error.cause() != nullptr ? error.cause()->what() : "");
    json.list("items", error.items(), write_item);
    return json.done();
}

class Driver {
  public:
    std::string run(const std::string& line) {
        std::istringstream words(line);
        std::string command;
        words >> command;
        Json json;
        if (command == "connect") {
            connect(words);
        } else if (command == "ingest") {
            ingest(words, json);
        } else if (command == "camera") {
            const auto id = read<std::int64_t>(words);
            const auto width = read<int>(words);
            const auto height = read<int>(words);
            const auto k = numbers<4>(words);
            json.number("sequence",
                        session_->camera(covis::pinhole(id, width, height, k[0], k[1], k[2], k[3])));
        } else if (command == "keyframe") {
            json.number("sequence", keyframe(words));
        } else if (command == "closure") {
            const auto id = read<std::int64_t>(words);
            const auto i = read<std::int64_t>(words);
            const auto j = read<std::int64_t>(words);
            const auto pose = covis::Pose::from_matrix(numbers<16>(words));
            json.number("sequence", session_->closure(id, i, j, pose, numbers<21>(words)));
        } else if (command == "landmarks") {
            const auto count = read<std::size_t>(words);
            std::vector<std::int64_t> ids(count);
            for (std::size_t index = 0; index < count; ++index) {
                ids[index] = static_cast<std::int64_t>(index);
            }
            json.number("sequence", session_->landmarks(ids, std::vector<std::optional<covis::Vector3>>(
                                                                 count, covis::Vector3{1.0, 1.0, 1.0})));
        } else if (command == "next") {
            json.number("sequence", session_->next_sequence());
            json.number("keyframe", session_->next_keyframe_id());
            json.number("landmark", session_->next_landmark_id());
        } else if (command == "refine") {
            refine(words, json);
        } else if (command == "flush") {
            read<std::int64_t>(words);
            session_->flush(timeout(words));
        } else if (command == "wait_durable") {
            const auto sequence = optional_sequence(words);
            session_->wait_durable(sequence, timeout(words));
        } else if (command == "wait_optimized") {
            const auto sequence = optional_sequence(words);
            session_->wait_optimized(sequence, timeout(words));
        } else if (command == "wait_settled") {
            session_->wait_settled(timeout(words));
        } else if (command == "settled") {
            const auto map_id = read<std::string>(words);
            client_->wait_settled(map_id, timeout(words));
        } else if (command == "unanswered") {
            json.list("items", session_->unanswered(), [](Json& out, const covis::v1::IngestRequest& item) {
                std::string digits;
                for (const unsigned char byte : item.SerializeAsString()) {
                    digits += "0123456789abcdef"[byte >> 4];
                    digits += "0123456789abcdef"[byte & 15];
                }
                out.quote(digits);
            });
        } else if (command == "finish") {
            session_->finish(timeout(words));
        } else if (command == "abort") {
            session_->abort();
        } else if (command == "report") {
            report(json);
        } else if (command == "watch") {
            const auto map_id = read<std::string>(words);
            covis::WatchOptions options;
            options.retry = retry(words);
            map_.emplace(client_->watch(map_id, options));
        } else if (command == "map") {
            state(json);
        } else if (command == "wait_revision") {
            const auto revision = read<std::int64_t>(words);
            map_->wait(revision, timeout(words));
        } else if (command == "server_info") {
            json.string("version", client_->server_info().version());
        } else {
            throw covis::Error(covis::ErrorKind::kArgument, "no command " + command);
        }
        return json.done();
    }

  private:
    template <class Value>
    static Value read(std::istringstream& words) {
        Value value{};
        if (!(words >> value)) {
            throw covis::Error(covis::ErrorKind::kArgument, "a command lacks a word");
        }
        return value;
    }

    template <std::size_t Count>
    static std::array<double, Count> numbers(std::istringstream& words) {
        std::array<double, Count> values{};
        for (double& value : values) {
            // Reads nan, which a stream does not.
            value = std::stod(read<std::string>(words));
        }
        return values;
    }

    static covis::Timeout timeout(std::istringstream& words) {
        const auto ms = read<std::int64_t>(words);
        return ms == 0 ? covis::Timeout() : milliseconds(ms);
    }

    static std::optional<std::int64_t> optional_sequence(std::istringstream& words) {
        const auto sequence = read<std::int64_t>(words);
        return sequence == 0 ? std::optional<std::int64_t>() : sequence;
    }

    static covis::RetryPolicy retry(std::istringstream& words) {
        covis::RetryPolicy policy;
        policy.max_attempts = read<int>(words);
        policy.first_delay = milliseconds(read<std::int64_t>(words));
        policy.longest_delay = milliseconds(read<std::int64_t>(words));
        return policy;
    }

    void connect(std::istringstream& words) {
        const auto url = read<std::string>(words);
        covis::ConnectOptions options;
        options.link.keep_alive = milliseconds(read<std::int64_t>(words));
        options.link.keep_alive_timeout = milliseconds(read<std::int64_t>(words));
        options.link.deadline = milliseconds(read<std::int64_t>(words));
        client_.emplace(covis::Client::connect(url, options));
    }

    void ingest(std::istringstream& words, Json& json) {
        const auto map_id = read<std::string>(words);
        const auto client_id = read<std::string>(words);
        covis::SessionOptions options;
        options.lock_step = read<int>(words) != 0;
        options.max_unanswered = read<std::size_t>(words);
        options.retry = retry(words);
        options.on_ack = [this](const covis::v1::IngestAck& ack) {
            const std::lock_guard<std::mutex> lock(mutex_);
            acks_.emplace_back(ack.sequence(), ack.status());
        };
        session_.emplace(client_->ingest(map_id, client_id, options));
        json.number("epoch", session_->opened().epoch());
        json.number("max_message_bytes", session_->opened().max_message_bytes());
    }

    void refine(std::istringstream& words, Json& json) {
        covis::v1::RefinePoseRequest request;
        const auto k = numbers<4>(words);
        *request.mutable_camera() = covis::pinhole(0, 640, 480, k[0], k[1], k[2], k[3]);
        *request.mutable_world_from_camera() = covis::Pose::from_matrix(numbers<16>(words)).message();
        const auto count = read<std::size_t>(words);
        for (std::size_t index = 0; index < count; ++index) {
            const auto values = numbers<5>(words);
            auto& seen = *request.add_observations();
            seen.mutable_point_in_world()->set_x(values[0]);
            seen.mutable_point_in_world()->set_y(values[1]);
            seen.mutable_point_in_world()->set_z(values[2]);
            seen.mutable_pixel()->set_x(values[3]);
            seen.mutable_pixel()->set_y(values[4]);
        }
        const auto refined = client_->refine_pose(request);
        const std::array<covis::Pose, 1> found{covis::Pose::from_message(refined.world_from_camera())};
        json.list("pose", found, [](Json& out, const covis::Pose& pose) { write_pose(out.text(), pose); });
    }

    std::int64_t keyframe(std::istringstream& words) {
        covis::Keyframe keyframe;
        keyframe.id = read<std::int64_t>(words);
        keyframe.capture_time = std::chrono::nanoseconds(read<std::int64_t>(words));
        keyframe.world_from_camera = covis::Pose::from_matrix(numbers<16>(words));
        const auto count = read<std::size_t>(words);
        for (std::size_t index = 0; index < count; ++index) {
            covis::Observation seen;
            seen.landmark = read<std::int64_t>(words);
            const auto values = numbers<6>(words);
            seen.u = values[0];
            seen.v = values[1];
            seen.depth_m = values[2];
            seen.new_point = covis::Vector3{values[3], values[4], values[5]};
            keyframe.observations.push_back(seen);
        }
        return session_->keyframe(keyframe);
    }

    void report(Json& json) {
        const auto report = session_->report();
        json.number("sent", report.sent).number("acknowledged", report.acknowledged);
        json.number("duplicates", report.duplicates).number("rejected", report.rejected);
        json.number("durable_through", report.durable_through).number("optimized", report.optimized);
        json.number("optimized_through", report.optimized_through);
        json.number("failed_solves", report.failed_solves).number("revision", report.revision);
        json.number("reconnects", report.reconnects);
        const std::lock_guard<std::mutex> lock(mutex_);
        json.list("acks", acks_, [](Json& out, const auto& ack) {
            out.text() << '[' << ack.first << ',' << ack.second << ']';
        });
        acks_.clear();
    }

    void state(Json& json) const {
        const auto named = [](Json& out, const covis::Ref& ref) {
            out.text() << '[';
            out.quote(ref.client_id);
            out.text() << ',' << ref.id;
        };
        json.number("revision", map_->revision());
        json.list("poses", map_->poses(), [&](Json& out, const auto& one) {
            named(out, one.first);
            out.text() << ',';
            write_pose(out.text(), one.second);
            out.text() << ']';
        });
        json.list("landmarks", map_->landmarks(), [&](Json& out, const auto& one) {
            named(out, one.first);
            if (one.second) {
                const auto& p = *one.second;
                out.text() << ',' << p[0] << ',' << p[1] << ',' << p[2];
            }
            out.text() << ']';
        });
        json.list("constraints", map_->constraints(), [&](Json& out, const auto& one) {
            named(out, one.first);
            out.text() << ']';
        });
        json.list("frames", map_->clients(), [&](Json& out, const std::string& client_id) {
            out.text() << '[';
            out.quote(client_id);
            if (const auto pose = map_->map_from_odom(client_id)) {
                out.text() << ',';
                write_pose(out.text(), *pose);
            }
            out.text() << ']';
        });
        json.list("scales", map_->clients(), [&](Json& out, const std::string& client_id) {
            out.text() << '[';
            out.quote(client_id);
            out.text() << ',' << map_->scale(client_id) << ']';
        });
    }

    std::mutex mutex_;
    std::vector<std::pair<std::int64_t, int>> acks_;
    std::optional<covis::Client> client_;
    std::optional<covis::Session> session_;
    std::optional<covis::Map> map_;
};

}  // namespace

int main() {
    Driver driver;
    std::string line;
    while (std::getline(std::cin, line)) {
        try {
            std::cout << driver.run(line) << std::endl;
        } catch (const covis::Error& error) {
            std::cout << failed(error) << std::endl;
        }
    }
    return 0;
}
