//! The thread that follows a map. Nothing is thrown on it: what fails there is a value.

#include "covis/map.hpp"

#include <condition_variable>
#include <mutex>
#include <thread>

#include "covis/v1/map_service.grpc.pb.h"
#include "mirror.hpp"
#include "stream.hpp"

namespace covis {

struct Map::State {
    using Lock = std::unique_lock<std::mutex>;

    std::shared_ptr<const detail::Link> link;
    std::string map_id;
    WatchOptions options;
    detail::Retries retries;

    mutable std::mutex mutex;
    mutable std::condition_variable changed;
    detail::Mirror mirror;
    /// Counts changes, so that none is missed by who waits.
    std::uint64_t changes = 0;
    std::optional<Error> failure;
    bool is_closed = false;
    std::shared_ptr<grpc::ClientContext> call;
    std::thread follower;

    State(std::shared_ptr<const detail::Link> to, std::string map, WatchOptions how)
        : link(std::move(to)), map_id(std::move(map)), options(std::move(how)), retries(options.retry) {}

    ~State() {
        {
            const Lock lock(mutex);
            is_closed = true;
            if (call) {
                call->TryCancel();
            }
            changed.notify_all();
        }
        if (follower.joinable()) {
            follower.join();
        }
    }

    void run() noexcept {
        std::optional<Error> ended;
        try {
            ended = follow_all();
        } catch (const std::exception& error) {
            // Memory that is used up, or a bug of ours: it must reach those who wait.
            ended.emplace(ErrorKind::kProtocol, error.what());
        }
        const Lock lock(mutex);
        failure = std::move(ended);
        changed.notify_all();
    }

    Error follow_all() {
        while (true) {
            const Error error = follow();
            link->follow(error);
            Lock lock(mutex);
            if (is_closed) {
                return Error(ErrorKind::kClosed, "the watch has ended");
            }
            auto next = retries.next(error, detail::Clock::now());
            if (auto* last = std::get_if<Error>(&next)) {
                return std::move(*last);
            }
            changed.wait_for(lock, std::get<std::chrono::nanoseconds>(next), [this] { return is_closed; });
        }
    }

    /// One stream, to its end.
    Error follow() {
        v1::WatchMapRequest request;
        request.set_map_id(map_id);
        request.set_omit_landmarks(options.omit_landmarks);
        request.set_omit_constraints(options.omit_constraints);
        request.set_position_resolution_m(options.position_resolution_m);
        request.set_rotation_resolution_rad(options.rotation_resolution_rad);
        const auto context = std::make_shared<grpc::ClientContext>();
        link->prepare(*context);
        {
            const Lock lock(mutex);
            call = context;
            if (is_closed) {
                context->TryCancel();
            }
            request.set_map_uid(mirror.uid);
            if (!mirror.uid.empty()) {
                request.set_from_revision(mirror.revision);
            }
        }
        v1::MapService::Stub stub(link->channel());
        const auto reader = stub.WatchMap(context.get(), request);
        std::vector<v1::MapDelta> parts;
        v1::WatchMapResponse answer;
        std::optional<Error> error;
        while (!error && reader->Read(&answer)) {
            if (!answer.has_delta()) {
                continue;
            }
            parts.push_back(std::move(*answer.mutable_delta()));
            if (parts.back().last_part()) {
                error = apply(parts);
                parts.clear();
            }
        }
        if (error) {
            context->TryCancel();
        }
        const auto status = reader->Finish();
        if (error) {
            return *error;
        }
        // Watching ends with a status; an end without one is a link that went away.
        return status.ok() ? detail::broken("WatchMap", "the stream ended") : Error::of_call("WatchMap", status);
    }

    std::optional<Error> apply(const std::vector<v1::MapDelta>& parts) {
        std::optional<Error> error;
        MapChanges told;
        {
            const Lock lock(mutex);
            told = mirror.apply(parts, error);
            if (error) {
                return error;
            }
            retries.opened();
            retries.progress();
            ++changes;
        }
        changed.notify_all();
        return options.on_change ? detail::call_back(options.on_change, told) : std::nullopt;
    }

    template <class Read>
    auto read(Read get) const {
        const Lock lock(mutex);
        return get(mirror);
    }
};

Map::Map(std::unique_ptr<State> state) : state_(std::move(state)) {}
Map::Map(Map&&) noexcept = default;
Map& Map::operator=(Map&&) noexcept = default;
Map::~Map() = default;

Map Map::open(std::shared_ptr<const detail::Link> link, const std::string& map_id, WatchOptions options) {
    Map map(std::make_unique<State>(std::move(link), map_id, std::move(options)));
    map.state_->follower = std::thread(&State::run, map.state_.get());
    map.wait_until([&map] { return map.state_->read([](const auto& m) { return !m.uid.empty(); }); });
    return map;
}

std::int64_t Map::revision() const {
    return state_->read([](const auto& mirror) { return mirror.revision; });
}

v1::MapState Map::state() const {
    return state_->read([](const auto& mirror) { return mirror.state; });
}

std::optional<v1::PendingWork> Map::pending_work() const {
    return state_->read([](const auto& mirror) { return mirror.pending_work; });
}

std::set<std::string> Map::clients() const {
    return state_->read([](const auto& mirror) { return mirror.clients; });
}

std::map<Ref, Pose> Map::poses() const {
    return state_->read([](const auto& mirror) { return mirror.poses; });
}

std::optional<Pose> Map::pose(const Ref& keyframe) const {
    return state_->read([&](const auto& mirror) {
        const auto found = mirror.poses.find(keyframe);
        return found == mirror.poses.end() ? std::nullopt : std::optional<Pose>(found->second);
    });
}

std::map<Ref, std::chrono::nanoseconds> Map::times() const {
    return state_->read([](const auto& mirror) { return mirror.times; });
}

std::map<Ref, std::optional<Vector3>> Map::landmarks() const {
    return state_->read([](const auto& mirror) { return mirror.landmarks; });
}

std::map<Ref, v1::Camera> Map::cameras() const {
    return state_->read([](const auto& mirror) { return mirror.cameras; });
}

std::map<Ref, v1::Constraint> Map::constraints() const {
    return state_->read([](const auto& mirror) { return mirror.constraints; });
}

std::vector<Closure> Map::closures() const { return detail::closures(constraints()); }

std::optional<Pose> Map::map_from_odom(const std::string& client_id) const {
    return state_->read([&](const auto& mirror) {
        const auto found = mirror.frames.find(client_id);
        return found == mirror.frames.end() ? std::nullopt : std::optional<Pose>(found->second);
    });
}

double Map::scale(const std::string& client_id) const {
    return state_->read([&](const auto& mirror) {
        const auto found = mirror.scales.find(client_id);
        return found == mirror.scales.end() ? 1.0 : found->second;
    });
}

void Map::wait(std::int64_t revision, Timeout timeout) const {
    wait_until([&] { return this->revision() >= revision; }, timeout);
}

void Map::wait_until(const std::function<bool()>& is_met, Timeout timeout) const {
    const auto deadline = detail::Clock::now() + timeout.value_or(std::chrono::milliseconds(0));
    State::Lock lock(state_->mutex);
    while (true) {
        const std::uint64_t seen = state_->changes;
        lock.unlock();
        if (is_met()) {
            return;
        }
        lock.lock();
        const auto has_news = [&] { return state_->failure || state_->changes != seen; };
        if (!timeout) {
            state_->changed.wait(lock, has_news);
        } else if (!state_->changed.wait_until(lock, deadline, has_news)) {
            throw Error(ErrorKind::kTimeout, "the map did not come so far within " +
                                                 std::to_string(timeout->count()) + " ms");
        }
        // What changed before the end is still asked about.
        if (state_->failure && state_->changes == seen) {
            throw Error(*state_->failure);
        }
    }
}

}  // namespace covis
