#include "base/http_source.h"

#include <curl/curl.h>
#include <dlfcn.h>
#include <fmt/format.h>
#include <pthread.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <charconv>
#include <csignal>
#include <ctime>
#include <map>
#include <mutex>
#include <optional>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "base/interruption.h"
#include "base/server_file.h"

namespace splatvol {
namespace {

using std::chrono::milliseconds;

constexpr long max_redirects = 8;
constexpr const char* protocols = "http,https";
constexpr const char* library_name = "libcurl.so.4";  // of all versions since 2006

// Returns the address without user, password, query and fragment.
std::string without_secrets(const std::string& url) {
  const std::size_t host = url.find("://") + 3;
  std::string name = url.substr(0, url.find_first_of("?#", host));
  const std::size_t at = name.substr(0, name.find('/', host)).rfind('@');
  return at == std::string::npos ? name : name.erase(host, at + 1 - host);
}

// Blocks SIGPIPE. OpenSSL raises it when it writes to a connection that the server has closed, and the signal would end
// the program. libcurl's own protection does not work with several threads.
class NoSigpipe {
 public:
  NoSigpipe() {
    ::sigemptyset(&sigpipe_);
    ::sigaddset(&sigpipe_, SIGPIPE);
    ::sigset_t pending;
    ::sigpending(&pending);
    was_pending_ = ::sigismember(&pending, SIGPIPE) == 1;
    ::pthread_sigmask(SIG_BLOCK, &sigpipe_, &before_);
  }
  NoSigpipe(const NoSigpipe&) = delete;
  NoSigpipe& operator=(const NoSigpipe&) = delete;
  ~NoSigpipe() {
    constexpr timespec at_once{};
    while (!was_pending_ && ::sigtimedwait(&sigpipe_, nullptr, &at_once) < 0 && errno == EINTR) {
    }
    ::pthread_sigmask(SIG_SETMASK, &before_, nullptr);
  }

 private:
  ::sigset_t sigpipe_, before_;
  bool was_pending_;
};

// The functions of libcurl. The library is loaded when the first address is opened: with the libraries that it needs,
// it would take a third of the time in which a program starts.
// clang-format off
#define SPLATVOL_CURL_FUNCTIONS(OF)                                                                   \
  OF(global_init)                                                                                     \
  OF(easy_init) OF(easy_cleanup) OF(easy_getinfo) OF(easy_header) OF(easy_setopt) OF(easy_strerror)   \
  OF(multi_add_handle) OF(multi_cleanup) OF(multi_info_read) OF(multi_init) OF(multi_perform)         \
  OF(multi_poll) OF(multi_remove_handle)
// clang-format on
struct Curl {
#define SPLATVOL_DECLARE(name) decltype(&::curl_##name) name = nullptr;
  SPLATVOL_CURL_FUNCTIONS(SPLATVOL_DECLARE)
#undef SPLATVOL_DECLARE
  bool started = false;

  Curl() {
    void* library = ::dlopen(library_name, RTLD_NOW | RTLD_LOCAL);  // never closed
    if (library == nullptr) return;
    const auto find = [&](auto& function, const char* name) {
      function = reinterpret_cast<std::remove_reference_t<decltype(function)>>(::dlsym(library, name));
      return function != nullptr;
    };
#define SPLATVOL_FIND(name) find(name, "curl_" #name)&&
    started = SPLATVOL_CURL_FUNCTIONS(SPLATVOL_FIND) global_init(CURL_GLOBAL_DEFAULT) == CURLE_OK;
#undef SPLATVOL_FIND
  }
};

const Curl& libcurl() {
  static const Curl curl;
  return curl;
}

struct CloseTransfers {
  void operator()(CURLM* transfers) const { libcurl().multi_cleanup(transfers); }
};
struct CloseHandle {
  void operator()(CURL* handle) const { libcurl().easy_cleanup(handle); }
};

// A connection with its settings. Only the interface for several transfers lets a transfer be interrupted.
struct Connection {
  std::unique_ptr<CURLM, CloseTransfers> transfers;
  std::unique_ptr<CURL, CloseHandle> handle;

  // Runs the transfer to its end. Returns CURLE_ABORTED_BY_CALLBACK if it is interrupted.
  CURLcode run() const {
    if (libcurl().multi_add_handle(transfers.get(), handle.get()) != CURLM_OK) return CURLE_OUT_OF_MEMORY;
    CURLcode code = CURLE_ABORTED_BY_CALLBACK;
    for (bool done = false; !done && !is_interrupted();) {
      int running = 0, left = 0;
      CURLMcode state = libcurl().multi_perform(transfers.get(), &running);
      const CURLMsg* message = libcurl().multi_info_read(transfers.get(), &left);
      if (message && message->msg == CURLMSG_DONE) {
        code = message->data.result;
        done = true;
      } else if (state == CURLM_OK) {
        state =
            libcurl().multi_poll(transfers.get(), nullptr, 0, static_cast<int>(interruption_delay.count()), nullptr);
      }
      if (state == CURLM_OK) continue;
      code = CURLE_OUT_OF_MEMORY;  // nothing else can fail
      done = true;
    }
    libcurl().multi_remove_handle(transfers.get(), handle.get());
    return code;
  }
};

template <class T>
T info_of(CURL* handle, CURLINFO which) {
  T value{};
  libcurl().easy_getinfo(handle, which, &value);
  return value;
}

// Returns a header field of the last answer (redirects give several answers); "" if it is absent.
std::string header_of(CURL* handle, const char* field) {
  curl_header* header = nullptr;
  return libcurl().easy_header(handle, field, 0, CURLH_HEADER, -1, &header) == CURLHE_OK ? header->value : "";
}

// The numbers of a header such as "Content-Range: bytes 0-99/1234".
struct ContentRange {
  std::uint64_t first, last, size;
};

std::optional<ContentRange> parse_content_range(const std::string& text) {
  constexpr std::string_view unit = "bytes ";
  if (!text.starts_with(unit)) return {};
  ContentRange range{};
  const char* at = text.data() + unit.size();
  const char* const end = text.data() + text.size();
  for (const auto& [number, delimiter] : {std::pair{&range.first, '-'}, {&range.last, '/'}, {&range.size, '\0'}}) {
    const auto [stop, error] = std::from_chars(at, end, *number);
    if (error != std::errc() || (delimiter == '\0' ? stop != end : stop == end || *stop != delimiter)) return {};
    at = stop + 1;
  }
  return range;
}

// Identifies the file on the server, to notice a change.
struct Content {
  std::uint64_t size = 0;
  std::string version;  // ETag, or else Last-Modified
  bool operator==(const Content&) const = default;
};

struct Failure {
  std::string reason;
  bool may_pass = false;
  milliseconds wait{0};  // that the server asks for before the next attempt
};

Failure failure_of_status(CURL* handle, long status) {
  const bool may_pass = status == 429 || status >= 500;
  const auto wished = std::min<curl_off_t>(info_of<curl_off_t>(handle, CURLINFO_RETRY_AFTER), 1 << 30);
  static const std::map<long, const char*> meanings = {
      {200, "no support for ranges of bytes, without which it would all have to be downloaded"},
      {401, "a user and a password are needed"},
      {403, "forbidden"},
      {404, "not found"},
      {407, "the proxy wants a user and a password"},
      {410, "gone"},
      {416, "no such range of bytes"},
      {429, "too many requests"}};
  const auto known = meanings.find(status);
  const char* other = status >= 500 ? "trouble of its own" : "not what was asked for";
  return {fmt::format("the server answers {}: {}", status, known == meanings.end() ? other : known->second), may_pass,
          std::chrono::seconds(wished)};
}

// A refused connection is final: no server is there.
bool may_pass(CURLcode code) {
  constexpr std::array passing = {CURLE_OPERATION_TIMEDOUT, CURLE_RECV_ERROR, CURLE_SEND_ERROR,   CURLE_GOT_NOTHING,
                                  CURLE_PARTIAL_FILE,       CURLE_HTTP2,      CURLE_HTTP2_STREAM, CURLE_HTTP3};
  return std::ranges::find(passing, code) != passing.end();
}

// One request, and the answer.
class Exchange {
 public:
  Exchange(const Exchange&) = delete;
  Exchange& operator=(const Exchange&) = delete;

  // Asks for ranges. Returns nothing if all bytes came.
  std::optional<Failure> run(const std::string& ranges) {
    std::array<char, CURL_ERROR_SIZE> text{};
    libcurl().easy_setopt(handle_, CURLOPT_RANGE, ranges.c_str());
    libcurl().easy_setopt(handle_, CURLOPT_WRITEFUNCTION, &Exchange::receive);
    libcurl().easy_setopt(handle_, CURLOPT_WRITEDATA, this);
    libcurl().easy_setopt(handle_, CURLOPT_ERRORBUFFER, text.data());
    const CURLcode code = [&] {
      const NoSigpipe guard;
      return connection_.run();
    }();
    libcurl().easy_setopt(handle_, CURLOPT_ERRORBUFFER, nullptr);

    if (is_interrupted()) return Failure{"interrupted"};
    if (code == CURLE_OK) check_once();
    if (failure_) return failure_;
    if (code != CURLE_OK) {
      if (checked_ && is_complete()) return {};
      return Failure{text[0] != '\0' ? text.data() : libcurl().easy_strerror(code), may_pass(code)};
    }
    return finish();
  }

 protected:
  // `content`: from earlier answers. If it is empty, this answer sets it.
  Exchange(const Connection& connection, std::optional<Content>& content)
      : handle_(connection.handle.get()), connection_(connection), content_(content) {}
  ~Exchange() = default;

  // Checks the header of an answer with status 206. Returns nothing if it is good.
  virtual std::optional<Failure> check() = 0;

  // Takes the next bytes of the body.
  virtual std::optional<Failure> take(std::span<const char> bytes) = 0;

  // Whether all bytes have come.
  [[nodiscard]] virtual bool is_complete() const = 0;

  // Ends an answer that has come as a whole.
  virtual std::optional<Failure> finish() = 0;

  // Checks that a file of this size is the one that is open.
  std::optional<Failure> check_content(std::uint64_t size) {
    std::string version = header_of(handle_, "ETag");
    if (version.empty()) version = header_of(handle_, "Last-Modified");
    const Content content{size, std::move(version)};
    if (!content_) content_ = content;
    if (content != *content_) return changed();
    return {};
  }

  CURL* handle_;

 private:
  static std::size_t receive(const char* bytes, std::size_t /*one*/, std::size_t count, void* self) {
    return static_cast<Exchange*>(self)->add({bytes, count}) ? count : CURL_WRITEFUNC_ERROR;
  }

  // Returns false to end the transfer.
  bool add(std::span<const char> bytes) {
    check_once();
    if (!failure_) failure_ = take(bytes);
    return !failure_;
  }

  void check_once() {
    if (std::exchange(checked_, true)) return;
    const long status = info_of<long>(handle_, CURLINFO_RESPONSE_CODE);
    if (status == 416 && content_)
      failure_ = changed();
    else
      failure_ = status == 206 ? check() : failure_of_status(handle_, status);
  }

  static Failure changed() { return {file_changed}; }

  const Connection& connection_;
  std::optional<Content>& content_;
  bool checked_ = false;
  std::optional<Failure> failure_;
};

// One request for the bytes from `offset` on: out.size() of them, or fewer if the file ends before.
class RangeExchange final : public Exchange {
 public:
  RangeExchange(const Connection& connection, std::uint64_t offset, std::span<std::byte> out,
                std::optional<Content>& content)
      : Exchange(connection, content), offset_(offset), out_(out) {}

  std::optional<Failure> run() { return Exchange::run(fmt::format("{}-{}", offset_, offset_ + out_.size() - 1)); }

  // Bytes that have been received, from the beginning of `out`; valid after a failure too.
  std::size_t received() const { return received_; }

 private:
  std::optional<Failure> check() override {
    const std::string text = header_of(handle_, "Content-Range");
    const auto range = parse_content_range(text);
    if (!range || range->first != offset_ || range->size <= offset_ ||
        range->last - offset_ != std::min<std::uint64_t>(out_.size(), range->size - offset_) - 1)
      return Failure{
          fmt::format("asked for bytes {} to {}, the server answers '{}'", offset_, offset_ + out_.size() - 1, text)};
    expected_ = range->last - range->first + 1;
    return check_content(range->size);
  }

  std::optional<Failure> take(std::span<const char> bytes) override {
    if (bytes.size() > expected_ - received_) return Failure{"the server sends more than was asked for"};
    std::ranges::copy(std::as_bytes(bytes), out_.begin() + static_cast<std::ptrdiff_t>(received_));
    received_ += bytes.size();
    return {};
  }

  bool is_complete() const override { return received_ == expected_; }

  std::optional<Failure> finish() override {
    if (is_complete()) return {};
    return Failure{fmt::format("{} bytes came instead of {}", received_, expected_), true};
  }

  std::uint64_t offset_;
  std::span<std::byte> out_;
  std::size_t expected_ = 0;
  std::size_t received_ = 0;
};

// One request for several ranges. The answer has them as parts of a message (RFC 9110, 14.6), in any order; a server
// may join some.
class PartsExchange final : public Exchange {
 public:
  PartsExchange(const Connection& connection, std::span<const ByteSource::Part> parts, std::optional<Content>& content)
      : Exchange(connection, content), parts_(parts), most_bytes_(std::size_t{4} << 10) {
    for (const ByteSource::Part& part : parts) most_bytes_ += part.out.size() + head_bytes_of_part;
  }

  std::optional<Failure> run() {
    std::string ranges;
    for (const ByteSource::Part& part : parts_)
      ranges += fmt::format("{}{}-{}", ranges.empty() ? "" : ",", part.offset, part.offset + part.out.size() - 1);
    return Exchange::run(ranges);
  }

 private:
  static constexpr std::size_t head_bytes_of_part = std::size_t{2} << 10;  // with gaps that a server closes

  std::optional<Failure> check() override {
    std::string type = header_of(handle_, "Content-Type");
    std::ranges::transform(type, type.begin(), [](char c) { return c >= 'A' && c <= 'Z' ? char(c - 'A' + 'a') : c; });
    const std::size_t at = type.find("boundary=");
    if (!type.starts_with("multipart/byteranges") || at == std::string::npos) return no_parts();
    boundary_ = std::string(header_of(handle_, "Content-Type")).substr(at + std::string_view("boundary=").size());
    boundary_ = boundary_.substr(0, boundary_.find(';'));
    std::erase(boundary_, '"');
    boundary_.insert(0, "\r\n--");
    body_ = "\r\n";  // the first boundary may stand at the beginning
    return {};
  }

  std::optional<Failure> take(std::span<const char> bytes) override {
    if (bytes.size() > most_bytes_ - body_.size()) return Failure{"the server sends more than was asked for"};
    body_.append(bytes.data(), bytes.size());
    return {};
  }

  bool is_complete() const override { return false; }

  std::optional<Failure> finish() override {
    std::vector<std::pair<ContentRange, std::string_view>> came;
    const std::string_view body = body_;
    std::size_t at = body.find(boundary_);
    while (at != std::string_view::npos && !body.substr(at + boundary_.size()).starts_with("--")) {
      const std::size_t end = body.find("\r\n\r\n", at + boundary_.size());
      if (end == std::string_view::npos) return no_parts();
      const auto range = range_of(body.substr(at + boundary_.size(), end - at - boundary_.size()));
      const std::string_view bytes = body.substr(end + 4);
      if (!range || range->first > range->last || range->last - range->first >= bytes.size()) return no_parts();
      came.emplace_back(*range, bytes.substr(0, range->last - range->first + 1));
      if (auto other = check_content(range->size)) return other;
      at = body.find(boundary_, end + 4 + came.back().second.size());
    }
    for (const ByteSource::Part& part : parts_) {
      const auto found = std::ranges::find_if(came, [&](const auto& one) {
        return one.first.first <= part.offset && part.offset + part.out.size() - 1 <= one.first.last;
      });
      if (found == came.end()) return no_parts();
      const std::string_view bytes = found->second.substr(part.offset - found->first.first, part.out.size());
      std::ranges::copy(std::as_bytes(std::span(bytes)), part.out.begin());
    }
    return {};
  }

  // Of a part, whose head has lines.
  static std::optional<ContentRange> range_of(std::string_view head) {
    constexpr std::string_view field = "content-range:";
    while (!head.empty()) {
      std::string line(head.substr(0, head.find("\r\n")));
      head.remove_prefix(std::min(head.size(), line.size() + 2));
      std::ranges::transform(line, line.begin(), [](char c) { return c >= 'A' && c <= 'Z' ? char(c - 'A' + 'a') : c; });
      if (!line.starts_with(field)) continue;
      const std::size_t text = line.find_first_not_of(' ', field.size());
      return text == std::string::npos ? std::nullopt : parse_content_range(line.substr(text));
    }
    return {};
  }

  static Failure no_parts() { return {"the server does not answer with the ranges that were asked for"}; }

  std::span<const ByteSource::Part> parts_;
  std::size_t most_bytes_;
  std::string boundary_, body_;
};

class HttpSource final : public ByteSource {
 public:
  HttpSource(std::string url, HttpOptions options)
      : url_(std::move(url)), name_(without_secrets(url_)), options_(std::move(options)), address_(url_) {}

  std::uint64_t size() const override { return content_->size; }
  const std::string& name() const override { return name_; }
  std::uint64_t cheap_gap() const override { return gap_on_servers; }

  // Must be called first.
  Status open() {
    std::vector<std::byte> head(FileHead::usual_bytes);
    SPLATVOL_TRY(fetch(0, head));
    head.resize(std::min<std::uint64_t>(head.size(), size()));
    head_.keep(std::move(head));
    return {};
  }

  Status read(std::uint64_t offset, std::span<std::byte> out) override {
    SPLATVOL_TRY(check_range(*this, offset, out.size()));
    const Part rest = head_.fill(offset, out);
    return rest.out.empty() ? Status{} : fetch(rest.offset, rest.out);
  }

  bool may_read_parts() const override { return knows_parts_; }

  // A server that does not know several ranges of a request, or does not want them, is not asked again.
  Result<bool> read_parts(std::span<const Part> parts) override {
    if (!knows_parts_) return false;
    for (const Part& part : parts) SPLATVOL_TRY(check_range(*this, part.offset, part.out.size()));
    if (has_tried_parts_) return try_parts(parts);
    // One is enough to find out: who does not know them may answer with the whole file.
    const std::scoped_lock lock(first_parts_mutex_);
    if (!knows_parts_) return false;
    auto read = try_parts(parts);
    has_tried_parts_ = true;
    return read;
  }

 private:
  Result<bool> try_parts(std::span<const Part> parts) {
    bool passed = false;
    const Status got = transfer([&](const Connection& connection) {
      auto failure = PartsExchange(connection, parts, content_).run();
      passed = failure && failure->may_pass;
      return failure;
    });
    if (got) return true;
    if (passed || is_interrupted()) return tl::unexpected(got.error());
    knows_parts_ = false;
    return false;
  }

  // After a failure, goes on behind the bytes that have come.
  Status fetch(std::uint64_t offset, std::span<std::byte> out) {
    return transfer([&](const Connection& connection) {
      RangeExchange exchange(connection, offset, out, content_);
      auto failure = exchange.run();
      offset += exchange.received();
      out = out.subspan(exchange.received());
      return failure;
    });
  }

  // Calls `attempt` until it returns no failure, or one that is final.
  template <class Attempt>
  Status transfer(const Attempt& attempt_once) {
    SPLATVOL_TRY_ASSIGN(connection, acquire_connection());
    CURL* const handle = connection.handle.get();
    milliseconds wait = options_.first_wait;
    for (int attempt = 1;; ++attempt, wait *= 2) {
      const std::string address = current_address();
      libcurl().easy_setopt(handle, CURLOPT_URL, address.c_str());
      const std::optional<Failure> failure = attempt_once(connection);
      if (!failure) {
        const char* reached = info_of<const char*>(handle, CURLINFO_EFFECTIVE_URL);
        set_address(reached ? reached : url_);
        break;
      }
      // Where a redirection led to may be gone: the server can name another place.
      if (!failure->may_pass && address != url_ && !is_interrupted()) {
        set_address(url_);
        continue;
      }
      if (!failure->may_pass || attempt >= options_.attempts || failure->wait > options_.longest_wait)
        return fail(ErrorCode::io, "{}: {}", name_, failure->reason);
      const milliseconds pause = std::max(wait, failure->wait);
      options_.wait ? options_.wait(pause) : sleep_interruptibly(pause);
    }
    release_connection(std::move(connection));
    return {};
  }

  // Where the last redirection led to, so that not every request is redirected anew.
  std::string current_address() {
    const std::scoped_lock lock(mutex_);
    return address_;
  }

  void set_address(const std::string& address) {
    const std::scoped_lock lock(mutex_);
    address_ = address;
  }

  void release_connection(Connection connection) {
    const std::scoped_lock lock(mutex_);
    idle_.push_back(std::move(connection));
  }

  Result<Connection> acquire_connection() {
    {
      const std::scoped_lock lock(mutex_);
      if (!idle_.empty()) {
        Connection connection = std::move(idle_.back());
        idle_.pop_back();
        return connection;
      }
    }
    Connection connection;
    if (libcurl().started) {
      connection.transfers.reset(libcurl().multi_init());
      connection.handle.reset(libcurl().easy_init());
    }
    if (!connection.transfers || !connection.handle)
      return fail(ErrorCode::io, "{}: cannot load or start libcurl; install {}", name_, library_name);
    const auto set = [&](CURLoption option, auto value) {
      libcurl().easy_setopt(connection.handle.get(), option, value);
    };
    set(CURLOPT_PROTOCOLS_STR, protocols);
    set(CURLOPT_REDIR_PROTOCOLS_STR, redirect_protocols(url_));
    set(CURLOPT_FOLLOWLOCATION, 1L);
    set(CURLOPT_MAXREDIRS, max_redirects);
    set(CURLOPT_USERAGENT, "splatvol/" SPLATVOL_VERSION);
    set(CURLOPT_ACCEPT_ENCODING, "identity");  // ranges of a compressed file are useless
    set(CURLOPT_NOSIGNAL, 1L);
    set(CURLOPT_QUICK_EXIT, 1L);  // an interrupted transfer does not wait for a name to be resolved
    set(CURLOPT_CONNECTTIMEOUT_MS, static_cast<long>(options_.connect_timeout.count()));
    set(CURLOPT_LOW_SPEED_LIMIT, options_.slowest);
    set(CURLOPT_LOW_SPEED_TIME, static_cast<long>(options_.stall_timeout.count()));
    return connection;
  }

  const std::string url_;
  const std::string name_;
  const HttpOptions options_;
  std::optional<Content> content_;  // constant once open
  FileHead head_;
  std::atomic<bool> knows_parts_ = true, has_tried_parts_ = false;
  std::mutex first_parts_mutex_;
  std::mutex mutex_;
  std::vector<Connection> idle_;
  std::string address_;
};

}  // namespace

const char* redirect_protocols(std::string_view url) { return url.starts_with("https:") ? "https" : protocols; }

Result<std::unique_ptr<ByteSource>> open_url(const std::string& url, const HttpOptions& options) {
  if (!url.starts_with("http://") && !url.starts_with("https://"))
    return fail(ErrorCode::invalid_argument, "not an address that begins with http:// or https://");
  auto source = std::make_unique<HttpSource>(url, options);
  SPLATVOL_TRY(source->open());
  return source;
}

}  // namespace splatvol
