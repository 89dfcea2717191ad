#include "base/http_source.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <thread>

#include "base/addresses.h"
#include "base/interruption.h"
#include "tests/support/loopback.h"
#include "tests/support/nginx.h"
#include "tests/support/results.h"
#include "tests/support/scripted_server.h"
#include "tests/support/source_reads.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using std::chrono::milliseconds;
using namespace ::testing;

constexpr std::size_t head_bytes = 32u << 10;  // that opening asks for

void expect_one_line(const Error& error, const std::string& name, const std::string& reason) {
  EXPECT_THAT(error.message, StartsWith(name + ": "));
  EXPECT_THAT(error.message, HasSubstr(reason));
  EXPECT_THAT(error.message, Not(HasSubstr("\n")));
}

// --- With a real server.

struct HttpSource : testing::Test {
  void SetUp() override {
    nginx_ = Nginx::start(folder_.path());
    if (!nginx_) GTEST_SKIP() << "no nginx on this machine (package nginx)";
    folder_.write("data", text_);
  }

  std::vector<std::string> log() const {
    std::ifstream file(folder_.path("access.log"));
    std::vector<std::string> lines;
    for (std::string line; std::getline(file, line);) lines.push_back(line);
    return lines;
  }

  TempFolder folder_;
  std::unique_ptr<Nginx> nginx_;
  const std::string text_ = random_text(300'000, 1);
};

TEST_F(HttpSource, ReadsRandomRangesFromSeveralThreads) {
  const auto source = value_of(open_url(nginx_->url("data")));
  ASSERT_EQ(source->size(), text_.size());
  EXPECT_EQ(source->name(), nginx_->url("data"));

  EXPECT_THAT(mistakes_of_threads(*source, text_), Each(""));
}

TEST_F(HttpSource, ReadsEveryRangeAroundTheEndsAndNoneThatLeavesTheFile) {
  const auto source = open_url(nginx_->url("data")).value();
  expect_ranges_near({2, head_bytes, text_.size()}, *source, text_);
}

TEST_F(HttpSource, AsksForWhatIsReadAndNothingElse) {
  const auto source = open_url(nginx_->url("data")).value();
  std::string all(text_.size(), '?'), first(head_bytes, '?'), middle(1000, '?'), last(1, '?');
  EXPECT_TRUE(read_at(*source, 0, first));  // these came with the size
  EXPECT_TRUE(read_at(*source, 100'000, middle));
  EXPECT_TRUE(read_at(*source, text_.size() - 1, last));
  EXPECT_TRUE(read_at(*source, 0, all));
  EXPECT_EQ(first + middle + last, text_.substr(0, head_bytes) + text_.substr(100'000, 1000) + text_.back());
  EXPECT_EQ(all, text_);
  nginx_.reset();  // its log is complete
  EXPECT_THAT(log(), ElementsAre("206 32768 bytes=0-32767", "206 1000 bytes=100000-100999", "206 1 bytes=299999-299999",
                                 "206 267232 bytes=32768-299999"));
}

TEST_F(HttpSource, ReadsManyPartsByOneRequest) {
  const auto source = value_of(open_url(nginx_->url("data")));
  for (const std::size_t count : {2u, 3u, 100u}) {
    std::vector<std::string> texts;
    for (std::size_t i = 0; i < count; ++i) texts.emplace_back(1 + i % 3, '?');
    std::vector<ByteSource::Part> parts;
    for (std::size_t i = 0; i < count; ++i)
      parts.push_back({40'000 + 2'000 * i, std::as_writable_bytes(std::span(texts[i]))});
    EXPECT_TRUE(value_of(source->read_parts(parts)));
    for (std::size_t i = 0; i < count; ++i) EXPECT_EQ(texts[i], text_.substr(40'000 + 2'000 * i, texts[i].size()));
  }
  std::string last(1, '?');  // when it is answered, the answers before are in the log
  EXPECT_TRUE(read_at(*source, 299'999, last));
  const auto of_parts = [](const std::string& line) { return line.find("40000-") != std::string::npos; };
  EXPECT_EQ(std::ranges::count_if(log(), of_parts), 3);
}

TEST_F(HttpSource, ReadsFilesShorterThanTheFirstRequest) {
  folder_.write("short", "0123456789");
  const auto source = open_url(nginx_->url("short")).value();
  ASSERT_EQ(source->size(), 10u);
  std::string out(10, '?');
  EXPECT_TRUE(read_at(*source, 0, out));
  EXPECT_EQ(out, "0123456789");
  EXPECT_FALSE(read_at(*source, 1, out));
}

TEST_F(HttpSource, RefusesWhatIsNotServedInRanges) {
  const auto ignoring = open_url(nginx_->url("plain/data"));
  ASSERT_FALSE(ignoring);
  expect_one_line(ignoring.error(), nginx_->url("plain/data"), "200: no support for ranges");
  const auto missing = open_url(nginx_->url("missing"));
  ASSERT_FALSE(missing);
  expect_one_line(missing.error(), nginx_->url("missing"), "404: not found");
  std::filesystem::create_directory(folder_.path("folder"));
  const auto folder = open_url(nginx_->url("folder/"));
  ASSERT_FALSE(folder);
  expect_one_line(folder.error(), nginx_->url("folder/"), "403: forbidden");
  folder_.write("empty", "");
  const auto empty = open_url(nginx_->url("empty"));
  ASSERT_FALSE(empty);
  expect_one_line(empty.error(), nginx_->url("empty"), "the server answers");
  nginx_.reset();  // its log is complete
  EXPECT_EQ(log().size(), 4u) << "none of them is worth another attempt";
}

TEST_F(HttpSource, NoticesAFileThatIsReplacedWhileOpen) {
  const auto read_after = [&](const std::string& name, const std::string& text) {
    folder_.write(name, text_);
    const auto source = open_url(nginx_->url(name)).value();
    folder_.write("new", text);
    // The server distinguishes versions by their size and the second of their last change.
    std::filesystem::last_write_time(folder_.path("new"), std::filesystem::file_time_type::clock::now() +
                                                              std::chrono::hours(text.size() == text_.size() ? 1 : 0));
    std::filesystem::rename(folder_.path("new"), folder_.path(name));
    std::string out(100, '?');
    const Status status = read_at(*source, 200'000, out);
    return status ? "read" : status.error().message;
  };
  for (const std::size_t bytes : {text_.size(), text_.size() + 1, std::size_t{100'000}, std::size_t{0}})
    EXPECT_THAT(read_after(fmt::format("file{}", bytes), random_text(bytes, 2)), HasSubstr("the file changed"))
        << bytes;
}

TEST_F(HttpSource, OneNameForFilesAndAddresses) {
  std::string out(text_.size(), '?');
  for (const std::string& name : {nginx_->url("data"), folder_.path("data")}) {
    const auto source = value_of(open_file_or_url(name));
    EXPECT_EQ(source->name(), name);
    EXPECT_TRUE(read_at(*source, 0, out));
    EXPECT_EQ(out, text_);
  }
}

TEST_F(HttpSource, RefusesAServerThatDoesNotSpeakTls) {
  const std::string url = "https" + nginx_->url("data").substr(4);
  const auto source = open_url(url);
  ASSERT_FALSE(source);
  expect_one_line(source.error(), url, "SSL");
}

// --- With servers that misbehave. This is the content that they serve, if any:

const std::string& served() {
  static const std::string text = random_text(100'000, 3);
  return text;
}

struct Header {
  std::string status = "206 Partial Content";
  std::string etag = "\"one\"";
  std::uint64_t size = served().size();
  std::int64_t shift = 0;    // of the announced range
  std::int64_t missing = 0;  // bytes of the range that are not sent
  bool length = true;        // the answer says how many bytes come
};

Reply part(std::size_t from, std::size_t count, const Header& header = {}, Reply::Then then = Reply::Then::keep) {
  const auto first = static_cast<std::int64_t>(from) + header.shift;
  std::string body = served().substr(from, count);
  body.resize(static_cast<std::size_t>(static_cast<std::int64_t>(body.size()) - header.missing));
  const std::string length = header.length ? fmt::format("Content-Length: {}\r\n", count) : "";
  return {fmt::format("HTTP/1.1 {}\r\nContent-Range: bytes {}-{}/{}\r\nETag: {}\r\n{}\r\n{}", header.status, first,
                      first + static_cast<std::int64_t>(count) - 1, header.size, header.etag, length, body),
          then};
}

Reply head(const Header& header = {}) { return part(0, head_bytes, header); }

Reply answer(const std::string& status, const std::string& fields = "") {
  return {fmt::format("HTTP/1.1 {}\r\nContent-Length: 0\r\n{}\r\n", status, fields), Reply::Then::keep};
}

// Records each wait instead of waiting.
struct Patience {
  std::vector<milliseconds> waits;
  HttpOptions options() {
    HttpOptions options;
    options.wait = [this](milliseconds wait) { waits.push_back(wait); };
    return options;
  }
};

// Opens the file of the server and reads 1000 bytes at 50 000. Returns "read", or the error.
std::string outcome(const ScriptedServer& server, const HttpOptions& options) {
  const auto source = open_url(server.url("data"), options);
  if (!source) return source.error().message;
  std::string out(1000, '?');
  const Status status = read_at(**source, 50'000, out);
  if (!status) return status.error().message;
  return out == served().substr(50'000, 1000) ? "read" : "other bytes";
}

TEST(MisbehavingServer, FailuresThatPassAreTriedAgainLaterAndLater) {
  const std::vector<Reply> passing = {
      answer("500 Internal Server Error"),
      answer("503 Service Unavailable"),
      part(50'000, 1000, {.missing = 1000}, Reply::Then::close),
      part(50'000, 1000, {.missing = 1000}, Reply::Then::reset),
      {"", Reply::Then::close},
      {"HTTP/1.1 206 Partial", Reply::Then::close},
      part(50'000, 1000, {.missing = 1000, .length = false}, Reply::Then::close),
  };
  for (const Reply& reply : passing) {
    ScriptedServer server({head(), reply, reply, part(50'000, 1000)});
    Patience patience;
    EXPECT_EQ(outcome(server, patience.options()), "read") << reply.text;
    // libcurl itself asks again, at once, if the server has closed a kept connection.
    EXPECT_THAT(patience.waits,
                AnyOf(ElementsAre(milliseconds(250)), ElementsAre(milliseconds(250), milliseconds(500))));
  }
}

TEST(MisbehavingServer, ATransferThatBreaksOffGoesOnWhereItEnded) {
  ScriptedServer server({head(), part(50'000, 1000, {.missing = 400}, Reply::Then::close), part(50'600, 400)});
  Patience patience;
  EXPECT_EQ(outcome(server, patience.options()), "read");
  const auto requests = server.requests();
  ASSERT_EQ(requests.size(), 3u);
  EXPECT_THAT(requests[2], HasSubstr("Range: bytes=50600-50999\r\n"));
}

TEST(MisbehavingServer, AttemptsEnd) {
  ScriptedServer server({head(), answer("502 Bad Gateway")});
  Patience patience;
  EXPECT_THAT(outcome(server, patience.options()), HasSubstr("the server answers 502"));
  EXPECT_EQ(server.requests().size(), 1u + 4u);
  EXPECT_THAT(patience.waits, ElementsAre(milliseconds(250), milliseconds(500), milliseconds(1000)));
}

TEST(MisbehavingServer, WaitsAsLongAsTheServerWishesWithinReason) {
  ScriptedServer busy({answer("429 Too Many Requests", "Retry-After: 7\r\n"), head(), part(50'000, 1000)});
  Patience patience;
  EXPECT_EQ(outcome(busy, patience.options()), "read");
  EXPECT_THAT(patience.waits, ElementsAre(milliseconds(7000)));

  ScriptedServer never({answer("503 Service Unavailable", "Retry-After: 9000000000000000000\r\n")});
  Patience none;
  EXPECT_THAT(outcome(never, none.options()), HasSubstr("the server answers 503"));
  EXPECT_THAT(none.waits, ElementsAre());
}

// Asks for bytes 50 000 to 50 009 and 60 000 to 60 019. Returns "read", "cannot" or the error.
std::string outcome_of_parts(ByteSource& source) {
  std::string first(10, '?'), second(20, '?');
  const std::vector<ByteSource::Part> parts = {{50'000, std::as_writable_bytes(std::span(first))},
                                               {60'000, std::as_writable_bytes(std::span(second))}};
  const auto read = source.read_parts(parts);
  if (!read) return read.error().message;
  if (!*read) return "cannot";
  return first == served().substr(50'000, 10) && second == served().substr(60'000, 20) ? "read" : "other bytes";
}

Reply parts_of(const std::string& body, const std::string& type = "multipart/byteranges; boundary=B",
               const std::string& status = "206 Partial Content") {
  return {fmt::format("HTTP/1.1 {}\r\nContent-Type: {}\r\nETag: \"one\"\r\nContent-Length: {}\r\n\r\n{}", status, type,
                      body.size(), body),
          Reply::Then::keep};
}

std::string part_of(std::size_t from, std::size_t count, std::size_t size = served().size()) {
  return fmt::format("\r\n--B\r\nContent-Type: x/y\r\nContent-range: bytes {}-{}/{}\r\n\r\n{}", from, from + count - 1,
                     size, served().substr(from, count));
}

TEST(MisbehavingServer, PartsComeInAnyOrderAndJoined) {
  const std::string first = part_of(50'000, 10), second = part_of(60'000, 20), end = "\r\n--B--\r\n";
  for (const std::string& body : {first + second + end, second + first + end, "preamble" + first + second + end,
                                  (first + second + end).substr(2), part_of(49'990, 30) + second + end}) {
    const ScriptedServer server({head(), parts_of(body)});
    EXPECT_EQ(outcome_of_parts(*value_of(open_url(server.url("data")))), "read") << body;
    EXPECT_THAT(server.requests()[1], HasSubstr("Range: bytes=50000-50009,60000-60019"));
  }
  const ScriptedServer quoted({head(), parts_of(first + second + end, "Multipart/ByteRanges; boundary=\"B\"; a=b")});
  EXPECT_EQ(outcome_of_parts(*value_of(open_url(quoted.url("data")))), "read");
}

// A server that does not answer with parts is asked for single ranges from then on.
TEST(MisbehavingServer, WithoutPartsIsNotAskedAgain) {
  const std::string first = part_of(50'000, 10), second = part_of(60'000, 20), end = "\r\n--B--\r\n";
  const std::string other = part_of(60'000, 20, 7);
  std::string cut = first + second;
  cut.resize(cut.size() - 1);
  for (const Reply& reply :
       {answer("200 OK"), answer("400 Bad Request"), answer("416 Range Not Satisfiable"), part(50'000, 10),
        parts_of(first + end), parts_of(cut), parts_of(second + end), parts_of(""), parts_of("\r\n--B\r\n"),
        parts_of("\r\n--B\r\nContent-Range: bytes 9-2/3\r\n\r\n"), parts_of(first + other + end),
        parts_of(first + second + end, "multipart/byteranges"), parts_of(std::string(10'000, 'x'))}) {
    const ScriptedServer server({head(), reply, part(50'000, 1000)});
    const auto source = value_of(open_url(server.url("data")));
    EXPECT_EQ(outcome_of_parts(*source), "cannot") << reply.text;
    const std::size_t requests = server.requests().size();
    EXPECT_EQ(outcome_of_parts(*source), "cannot");
    EXPECT_EQ(server.requests().size(), requests);
    std::string out(1000, '?');
    EXPECT_TRUE(read_at(*source, 50'000, out)) << reply.text;
    EXPECT_EQ(out, served().substr(50'000, 1000));
  }
}

TEST(MisbehavingServer, AStalledTransferIsTriedAgain) {
  ScriptedServer server(
      {head(), part(50'000, 1000, {.missing = 400}, Reply::Then::stall), {"", Reply::Then::stall}, part(50'600, 400)});
  Patience patience;
  HttpOptions options = patience.options();
  options.stall_timeout = std::chrono::seconds(1);
  EXPECT_EQ(outcome(server, options), "read");
  EXPECT_EQ(patience.waits.size(), 2u);
}

// A server that sends next to nothing, or headers without end, is no better than one that sends nothing.
TEST(MisbehavingServer, ADripAndEndlessHeadersAreEnded) {
  const Reply drip = part(50'000, 1000, {.missing = 990}, Reply::Then::drip);
  const Reply header_drip = {"HTTP/1.1 206 Partial Content\r\nX-", Reply::Then::drip};
  const Reply continues = {"HTTP/1.1 100 Continue\r\n\r\n", Reply::Then::repeat};
  const Reply headers = {"HTTP/1.1 206 Partial Content\r\n" + std::string(1000, 'X') + ": a\r\n", Reply::Then::repeat};
  for (const Reply& reply : {drip, header_drip, continues, headers}) {
    ScriptedServer server({head(), reply});
    Patience patience;
    HttpOptions options = patience.options();
    options.attempts = 2;
    options.stall_timeout = std::chrono::seconds(1);
    const auto start = std::chrono::steady_clock::now();
    EXPECT_THAT(outcome(server, options), HasSubstr("127.0.0.1")) << reply.text;
    EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(20)) << reply.text;
  }
}

TEST(Redirects, LeadFromPrivateAddressesToPrivateOnesOnly) {
  EXPECT_STREQ(redirect_protocols("https://host/file"), "https");
  EXPECT_STREQ(redirect_protocols("http://host/file"), "http,https");
}

// A server that sends nothing, or a part of the answer, or wants to be asked later. Each waits for ever, or a minute.
TEST(MisbehavingServer, AWaitIsInterrupted) {
  for (const Reply& reply : {Reply{"", Reply::Then::stall}, part(50'000, 1000, {.missing = 400}, Reply::Then::stall),
                             answer("503 Service Unavailable", "Retry-After: 59\r\n")}) {
    ScriptedServer server({head(), reply});
    const auto source = open_url(server.url("data")).value();
    std::stop_source stop;
    Status status, later;
    std::thread reader([&] {
      const Interruptible interruptible(stop.get_token());
      std::string out(1000, '?');
      status = read_at(*source, 50'000, out);
      later = read_at(*source, 50'000, out);
    });
    while (server.requests().size() < 2) std::this_thread::sleep_for(milliseconds(1));
    std::this_thread::sleep_for(milliseconds(100));  // it waits
    stop.request_stop();
    reader.join();
    for (const Status& ended : {status, later}) {
      ASSERT_FALSE(ended);
      expect_one_line(ended.error(), server.url("data"), "interrupted");
    }
    EXPECT_EQ(server.requests().size(), 2u) << reply.text;
  }
}

TEST(MisbehavingServer, WhatWillNotPassFailsAtOnce) {
  const std::vector<std::pair<Reply, std::string>> refusals = {
      {part(50'000, 1000, {.shift = 1}),
       "asked for bytes 50000 to 50999, the server answers 'bytes 50001-51000/100000'"},
      {part(50'001, 999), "the server answers 'bytes 50001-50999/100000'"},
      {part(50'000, 999), "the server answers 'bytes 50000-50998/100000'"},
      {part(50'000, 1001), "the server answers 'bytes 50000-51000/100000'"},
      {part(50'000, 1000, {.missing = -1, .length = false}), "sends more than was asked for"},
      {part(50'000, 1000, {.status = "200 OK"}), "200: no support for ranges"},
      {answer("206 Partial Content"), "the server answers ''"},
      {answer("206 Partial Content", "Content-Range: bytes 50000-50999/*\r\n"), "bytes 50000-50999/*"},
      {answer("206 Partial Content", "Content-Range: bytes 50000-50999/100000x\r\n"), "100000x"},
      {answer("206 Partial Content", "Content-Range: bytes -1-50999/100000\r\n"), "bytes -1-50999"},
      {answer("206 Partial Content", "Content-Range: bytes 50000-99999999999999999999/100000\r\n"), "9999/100000"},
      {part(50'000, 1000, {.etag = "\"two\""}), "the file changed"},
      {part(50'000, 1000, {.size = 100'001}), "the file changed"},
      {answer("416 Range Not Satisfiable", "Content-Range: bytes */10\r\n"), "the file changed"},
      {answer("404 Not Found"), "404: not found"},
      {answer("403 Forbidden"), "403: forbidden"},
      {answer("302 Found", "Location: ftp://127.0.0.1/data\r\n"), "rotocol"},
      {answer("302 Found", "Location: file:///etc/passwd\r\n"), "rotocol"},
  };
  for (const auto& [reply, reason] : refusals) {
    ScriptedServer server({head(), reply});
    Patience patience;
    EXPECT_THAT(outcome(server, patience.options()), HasSubstr(reason));
    EXPECT_THAT(patience.waits, ElementsAre()) << reply.text;
  }
}

TEST(MisbehavingServer, ABodyThatNobodyAskedForIsNotDownloaded) {
  // Too many bytes for the server to send before the client reads some.
  const std::string huge(16u << 20, 'x');
  ScriptedServer server(
      {{fmt::format("HTTP/1.1 200 OK\r\nContent-Length: {}\r\n\r\n{}", huge.size() + 1, huge), Reply::Then::stall}});
  // Waiting for the last byte would never end.
  EXPECT_THAT(outcome(server, {}), HasSubstr("200: no support for ranges"));
}

TEST(MisbehavingServer, RedirectsAreFollowedUntilTheyGoInCircles) {
  ScriptedServer elsewhere({head(), part(50'000, 1000)});
  const Reply there = answer("302 Found", fmt::format("Location: {}\r\n", elsewhere.url("data")));
  ScriptedServer here({there});
  EXPECT_EQ(outcome(here, {}), "read");

  ScriptedServer circle({answer("302 Found", "Location: /data\r\n")});
  Patience patience;
  EXPECT_THAT(outcome(circle, patience.options()), HasSubstr("redirects"));
  EXPECT_EQ(circle.requests().size(), 1u + 8u);
}

TEST(MisbehavingServer, ManyRequestsGoThroughOneConnection) {
  // This server has one connection at a time: a second would wait for ever.
  ScriptedServer server({head(), part(50'000, 1000)});
  const auto source = open_url(server.url("data")).value();
  for (int i = 0; i < 20; ++i) {
    std::string out(1000, '?');
    ASSERT_TRUE(read_at(*source, 50'000, out));
  }
  const auto requests = server.requests();
  EXPECT_EQ(requests.size(), 21u);
  EXPECT_THAT(requests[0], HasSubstr("User-Agent: splatvol/"));
  EXPECT_THAT(requests[0], HasSubstr("Accept-Encoding: identity\r\n"));
}

TEST(MisbehavingServer, CookiesAreNotKept) {
  Reply first = head();
  first.text.insert(first.text.find("ETag"), "Set-Cookie: who=you; Path=/\r\n");
  ScriptedServer server({first, part(50'000, 1000)});
  EXPECT_EQ(outcome(server, {}), "read");
  EXPECT_THAT(server.requests().at(1), Not(HasSubstr("Cookie")));
}

TEST(MisbehavingServer, WhatIsSecretInAnAddressIsSentAndNotTold) {
  ScriptedServer server({head(), answer("404 Not Found")});
  const std::string url = fmt::format("http://user:pass@127.0.0.1:{}/a@b?token=abc#part", server.port());
  const auto source = open_url(url).value();
  EXPECT_EQ(source->name(), server.url("a@b"));
  std::string out(1000, '?');
  const Status status = read_at(*source, 50'000, out);
  ASSERT_FALSE(status);
  expect_one_line(status.error(), server.url("a@b"), "404");
  EXPECT_THAT(server.requests().at(0), StartsWith("GET /a@b?token=abc HTTP/1.1\r\n"));
  EXPECT_THAT(server.requests().at(0), HasSubstr("Authorization: Basic dXNlcjpwYXNz\r\n"));
}

TEST(NoServer, EachReasonIsOneLine) {
  const Listener closed = listen_on_loopback();
  ::close(closed.descriptor);
  Patience patience;
  const auto expect_refusal = [&](const std::string& url, const std::string& reason) {
    const auto source = open_url(url, patience.options());
    ASSERT_FALSE(source);
    EXPECT_EQ(source.error().code, ErrorCode::io);
    expect_one_line(source.error(), url, reason);
  };
  expect_refusal(fmt::format("http://127.0.0.1:{}/data", closed.port), "connect");
  expect_refusal("http://" + std::string(64, 'x') + ".invalid/data", "resolve");  // too long for a host name
  expect_refusal("http://[/data", "");
  EXPECT_THAT(patience.waits, ElementsAre()) << "none of them passes";
  EXPECT_EQ(open_url("ftp://127.0.0.1/data").error().code, ErrorCode::invalid_argument);
}

}  // namespace
}  // namespace splatvol::test
