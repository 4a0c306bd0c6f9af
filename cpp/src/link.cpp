//! A channel from a URL, a token from where the caller says, certificates from files.

#include "link.hpp"

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <fstream>
#include <iterator>

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

std::string authorization(const std::string& url, const Place& place, const ConnectOptions& options) {
    const auto given = token_of(options);
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

}  // namespace

Link::Link(const std::string& url, const ConnectOptions& options) : url_(url), link_(options.link) {
    const Place place = split(url);
    authorization_ = authorization(url, place, options);
    if (options.cert_file.empty() != options.key_file.empty()) {
        throw Error(ErrorKind::kArgument, "cert_file and key_file belong together: one of them is missing");
    }
    std::shared_ptr<grpc::ChannelCredentials> credentials = grpc::InsecureChannelCredentials();
    if (place.is_secure) {
        grpc::SslCredentialsOptions tls;
        if (!options.ca_file.empty()) {
            tls.pem_root_certs = read(options.ca_file);
        }
        if (!options.cert_file.empty()) {
            tls.pem_cert_chain = read(options.cert_file);
            tls.pem_private_key = read(options.key_file);
        }
        credentials = grpc::SslCredentials(tls);
    }
    channel_ = grpc::CreateCustomChannel(place.host + ":" + place.port, credentials,
                                         arguments(link_, is_loopback(place.host)));
}

void Link::check() const {
    if (!channel_->WaitForConnected(std::chrono::system_clock::now() + link_.connect_timeout)) {
        throw Error(ErrorKind::kUnreachable, "no server answers at " + url_ + " within " +
                                                 std::to_string(link_.connect_timeout.count()) + " ms");
    }
}

void Link::prepare(grpc::ClientContext& context) const {
    if (!authorization_.empty()) {
        context.AddMetadata("authorization", authorization_);
    }
}

}  // namespace covis::detail
