//! A channel from a URL, a token from where the caller says, certificates from files.

#include "link.hpp"

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <sstream>

namespace covis::detail {
namespace {

constexpr int kMaxAnswerBytes = 256 * 1024 * 1024;

struct Place {
    bool is_secure = false;
    std::string host;
    std::string port;
};

Place split(const std::string& url) {
    const Error invalid(ErrorKind::kInvalidUrl,
                        "'" + url + "' is not the URL of a server, such as http://127.0.0.1:7411");
    Place place;
    std::string rest;
    if (url.rfind("https://", 0) == 0) {
        place = {true, "", "443"};
        rest = url.substr(8);
    } else if (url.rfind("http://", 0) == 0) {
        place = {false, "", "80"};
        rest = url.substr(7);
    }
    if (!rest.empty() && rest.back() == '/') {
        rest.pop_back();
    }
    // An address of IPv6 stands in brackets.
    const std::size_t bracket = rest.rfind(']');
    const std::size_t colon = rest.find(':', bracket == std::string::npos ? 0 : bracket);
    place.host = rest.substr(0, colon);
    if (colon != std::string::npos) {
        place.port = rest.substr(colon + 1);
    }
    const auto is_digit = [](unsigned char c) { return std::isdigit(c) != 0; };
    const bool is_port = !place.port.empty() && place.port.size() <= 5 &&
                         std::all_of(place.port.begin(), place.port.end(), is_digit) &&
                         std::atoi(place.port.c_str()) <= 65535;
    if (place.host.empty() || !is_port || place.host.find_first_of("/?#@ ") != std::string::npos) {
        throw invalid;
    }
    return place;
}

bool is_loopback(const std::string& host) {
    const auto is_number = [](unsigned char c) { return std::isdigit(c) != 0 || c == '.'; };
    return host == "localhost" || host == "[::1]" ||
           (host.rfind("127.", 0) == 0 && std::all_of(host.begin(), host.end(), is_number));
}

std::string read(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    std::string content{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
    if (!file.is_open() || file.bad()) {
        throw Error(ErrorKind::kArgument, "cannot read " + path);
    }
    return content;
}

/// The variable's value, nothing where it is not set or empty.
std::optional<std::string> variable(const char* name) {
    const char* value = std::getenv(name);
    return value != nullptr && *value != '\0' ? std::optional<std::string>(value) : std::nullopt;
}

std::optional<std::string> token_of(const ConnectOptions& options) {
    if (options.token) {
        return options.token;
    }
    // A file that is named on purpose wins over a variable that may stand there for another server.
    if (!options.token_file.empty()) {
        return read(options.token_file);
    }
    if (const auto file = variable("COVIS_TOKEN_FILE")) {
        return read(*file);
    }
    return variable("COVIS_TOKEN");
}

std::string authorization(const std::string& url, const Place& place, const std::optional<std::string>& given) {
    if (!given) {
        return {};
    }
    const std::size_t first = given->find_first_not_of(" \t\r\n");
    const std::size_t last = given->find_last_not_of(" \t\r\n");
    const std::string token = first == std::string::npos ? "" : given->substr(first, last - first + 1);
    const auto fits = [](unsigned char c) { return c >= 0x20 && c < 0x7f; };
    if (token.empty() || !std::all_of(token.begin(), token.end(), fits)) {
        throw Error(ErrorKind::kInvalidToken, "the token is empty or not one line of ASCII");
    }
    if (!place.is_secure && !is_loopback(place.host)) {
        throw Error(ErrorKind::kTokenInPlainText, "a token is not sent in plain text to " + url + ": use https");
    }
    return "Bearer " + token;
}

int milliseconds(std::chrono::milliseconds time) {
    return static_cast<int>(std::min<std::int64_t>(time.count(), 1'000'000'000));
}

grpc::ChannelArguments arguments(const LinkOptions& link, bool is_local) {
    grpc::ChannelArguments out;
    out.SetMaxReceiveMessageSize(kMaxAnswerBytes);
    out.SetMaxSendMessageSize(-1);
    out.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, milliseconds(link.keep_alive));
    out.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, milliseconds(link.keep_alive_timeout));
    // A ping that measures the link may be under way when it breaks; it is given up as soon.
    out.SetInt("grpc.http2.ping_timeout_ms", milliseconds(link.keep_alive_timeout));
    out.SetInt(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
    out.SetInt(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);
    // The retries of sessions decide how long to wait; the channel itself waits shortly.
    out.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 100);
    out.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, milliseconds(link.connect_timeout));
    out.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 1000);
    // Clients of one process do not share connections, so that closing one ends its own.
    out.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    if (is_local) {
        out.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
    }
    if (link.compress) {
        out.SetCompressionAlgorithm(GRPC_COMPRESS_GZIP);
    }
    return out;
}

/// Whether the connection stands until then, or, `once`, after the first attempt.
bool stands(grpc::Channel& channel, std::chrono::system_clock::time_point until, bool once) {
    auto state = channel.GetState(true);
    while (state != GRPC_CHANNEL_READY) {
        if (once && state == GRPC_CHANNEL_TRANSIENT_FAILURE) {
            return false;
        }
        if (!channel.WaitForStateChange(state, until)) {
            return false;
        }
        state = channel.GetState(true);
    }
    return true;
}

}  // namespace

Link::Link(const std::string& urls, const ConnectOptions& options) : options_(options) {
    if (options.cert_file.empty() != options.key_file.empty()) {
        throw Error(ErrorKind::kArgument, "cert_file and key_file belong together: one of them is missing");
    }
    // Read once, so that the token goes to every server of the deployment.
    options_.token = token_of(options);
    std::stringstream all(urls);
    for (std::string url; std::getline(all, url, ',');) {
        const std::size_t first = url.find_first_not_of(' ');
        url = first == std::string::npos ? "" : url.substr(first, url.find_last_not_of(' ') - first + 1);
        authorization_ = authorization(url, split(url), options_.token);
        given_.push_back(url);
    }
    if (given_.empty()) {
        split(urls);
    }
    at_ = open(given_.front());
}

Link::Server Link::open(const std::string& url) const {
    const Place place = split(url);
    // Not to another machine in plain text.
    authorization(url, place, options_.token);
    std::shared_ptr<grpc::ChannelCredentials> credentials = grpc::InsecureChannelCredentials();
    if (place.is_secure) {
        grpc::SslCredentialsOptions tls;
        if (!options_.ca_file.empty()) {
            tls.pem_root_certs = read(options_.ca_file);
        }
        if (!options_.cert_file.empty()) {
            tls.pem_cert_chain = read(options_.cert_file);
            tls.pem_private_key = read(options_.key_file);
        }
        credentials = grpc::SslCredentials(tls);
    }
    return {url, grpc::CreateCustomChannel(place.host + ":" + place.port, credentials,
                                           arguments(options_.link, is_loopback(place.host)))};
}

Link::Server Link::at() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return at_;
}

std::shared_ptr<const Link> Link::apart() const {
    auto link = std::make_shared<Link>(given_.front(), options_);
    link->given_ = given_;
    const std::lock_guard<std::mutex> lock(mutex_);
    link->at_ = at_;
    link->place_ = place_;
    return link;
}

bool Link::go_to(const std::string& url, std::size_t place) const noexcept {
    try {
        Server server = open(url);
        const std::lock_guard<std::mutex> lock(mutex_);
        at_ = std::move(server);
        place_ = place;
        return true;
    } catch (const std::exception&) {
        // The URL or the credentials cannot be used there.
        return false;
    }
}

bool Link::follow(const Error& error) const noexcept {
    std::size_t place = 0;
    bool is_given = false;
    {
        const std::lock_guard<std::mutex> lock(mutex_);
        place = place_;
        is_given = given_[place_] == at_.url;
    }
    if (const std::string* owner = error.owner()) {
        return go_to(*owner, place);
    }
    if (error.is_transient() && error.code() != grpc::StatusCode::RESOURCE_EXHAUSTED) {
        // Where an owner is gone, the server that named it may know the next one.
        const std::size_t next = is_given ? (place + 1) % given_.size() : place;
        if (!is_given || next != place) {
            go_to(given_[next], next);
        }
    }
    return false;
}

void Link::check() const {
    const auto wait = options_.link.connect_timeout;
    for (std::size_t place = 0; place < given_.size(); ++place) {
        if (place > 0 && !go_to(given_[place], place)) {
            continue;
        }
        // Of several servers the next one is tried as soon as the attempt fails.
        if (stands(*channel(), std::chrono::system_clock::now() + wait, given_.size() > 1)) {
            return;
        }
    }
    throw Error(ErrorKind::kUnreachable, "no server answers at " + given_.front() + " within " +
                                             std::to_string(wait.count()) + " ms");
}

void Link::prepare(grpc::ClientContext& context) const {
    if (!authorization_.empty()) {
        context.AddMetadata("authorization", authorization_);
    }
}

}  // namespace covis::detail
