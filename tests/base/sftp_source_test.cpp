#include "base/sftp_source.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <thread>

#include "base/interruption.h"
#include "base/sftp_protocol.h"
#include "tests/support/child.h"
#include "tests/support/results.h"
#include "tests/support/sftp_answers.h"
#include "tests/support/sftp_server.h"
#include "tests/support/source_reads.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using std::chrono::milliseconds;
using namespace ::testing;

constexpr std::size_t head_bytes = 32u << 10;  // that opening reads

// A folder with a file, and shells' command lines that stand in for ssh.
struct SftpTest : FolderTest {
  void SetUp() override { write("data", text_); }

  // Runs in the folder. `serve` starts OpenSSH's server, `pass` lets so many bytes through, `cut` ends the server then.
  [[nodiscard]] SftpOptions by(const std::string& command) const {
    return {.command = {"sh", "-c",
                        fmt::format(R"(cd '{}'
serve() {{ sh -c 'echo $$ > server; exec {}'; }}
pass() {{ dd bs=1 count=$1 status=none; }}
cut() {{ pass $1; kill $(cat server); }}
{})",
                                    folder_, sftp_server, command)}};
  }
  [[nodiscard]] std::string url(const std::string& name = "data") const { return "ssh://host" + path(name); }

  // Answers that a server sends when so many more reads have come.
  struct Later {
    std::size_t reads;
    std::string answers;
  };

  // A server that sends these bytes, whatever it is asked.
  [[nodiscard]] SftpOptions sending(const std::string& answers, const std::vector<Later>& later = {}) const {
    write("answers", answers);
    std::string script = fmt::format("cat answers; pass {} > /dev/null; ", opening_bytes());
    for (std::size_t i = 0; i < later.size(); ++i) {
      write(fmt::format("later{}", i), later[i].answers);
      script += fmt::format("pass {} > /dev/null; cat later{}; ", later[i].reads * read_bytes, i);
    }
    return by(script + "exec cat > /dev/null");
  }

  // Returns the bytes of the requests that open a file.
  [[nodiscard]] std::size_t opening_bytes() const {
    return sftp_init().size() + sftp_open(1, path("data")).size() + sftp_fstat(2, "h").size();
  }
  static inline const std::size_t read_bytes = sftp_read(1, "h", 0, 0).size();

  // Opens a file and reads 100 000 bytes at 50 000. Returns "read", or the error.
  [[nodiscard]] std::string outcome(const SftpOptions& options, const std::string& name = "data") const {
    const auto source = open_ssh(url(name), options);
    if (!source) return source.error().message;
    return outcome(**source);
  }

  [[nodiscard]] std::string outcome(ByteSource& source) const {
    std::string out(100'000, '?');
    const Status status = read_at(source, 50'000, out);
    if (!status) return status.error().message;
    return out == text_.substr(50'000, out.size()) ? "read" : "other bytes";
  }

  const std::string text_ = random_text(300'000, 1);
};

// --- With a real server.

struct SftpSource : SftpTest {
  void SetUp() override {
    if (!has_sftp_server()) GTEST_SKIP() << no_sftp_server;
    SftpTest::SetUp();
  }
  [[nodiscard]] SftpOptions options() const { return {.command = {sftp_server, "-R", "-d", folder_}}; }
};

TEST_F(SftpSource, ReadsRandomRangesFromSeveralThreads) {
  const auto source = value_of(open_ssh("ssh://me@host" + path("data"), options()));
  ASSERT_EQ(source->size(), text_.size());
  EXPECT_EQ(source->name(), url());

  EXPECT_THAT(mistakes_of_threads(*source, text_), Each(""));
}

TEST_F(SftpSource, ReadsEveryRangeAroundTheEndsAndNoneThatLeavesTheFile) {
  const auto source = value_of(open_ssh(url(), options()));
  expect_ranges_near({2, head_bytes, 2 * head_bytes, text_.size()}, *source, text_);
}

TEST_F(SftpSource, ReadsManyParts) {
  const auto source = value_of(open_ssh(url(), options()));
  EXPECT_TRUE(source->may_read_parts());
  std::vector<std::string> texts;
  for (std::size_t i = 0; i < 100; ++i) texts.emplace_back(1 + i % 3 * 1000, '?');
  std::vector<ByteSource::Part> parts;
  for (std::size_t i = 0; i < texts.size(); ++i)
    parts.push_back({2'500 * i, std::as_writable_bytes(std::span(texts[i]))});
  EXPECT_TRUE(value_of(source->read_parts(parts)));
  for (std::size_t i = 0; i < texts.size(); ++i) EXPECT_EQ(texts[i], text_.substr(2'500 * i, texts[i].size())) << i;
  parts[0].offset = text_.size();
  EXPECT_THAT(source->read_parts(parts), FailsWith(ErrorCode::invalid_data));
}

TEST_F(SftpSource, ReadsShortFilesAndNamesWithSigns) {
  write("a b%41?c.txt", "0123456789");
  const auto source = value_of(open_ssh("ssh://host" + path("a%20b%2541?c.txt"), options()));
  ASSERT_EQ(source->size(), 10u);
  std::string out(10, '?');
  EXPECT_TRUE(read_at(*source, 0, out));
  EXPECT_EQ(out, "0123456789");
  EXPECT_FALSE(read_at(*source, 1, out));
  write("empty", "");
  EXPECT_EQ(value_of(open_ssh("ssh://host/~/empty", options()))->size(), 0u) << "below the home folder";
}

TEST_F(SftpSource, RefusesWhatIsNoFileThere) {
  EXPECT_EQ(outcome(options(), "missing"), url("missing") + ": not found");
  std::filesystem::create_directory(path("folder"));
  EXPECT_EQ(outcome(options(), "folder"), url("folder") + ": not a regular file");
  EXPECT_THAT(open_ssh(url("missing"), options()), FailsWith(ErrorCode::io));
}

TEST_F(SftpSource, LeavesNothingBehind) {
  const auto descriptors = [] {
    return std::distance(std::filesystem::directory_iterator("/proc/self/fd"), std::filesystem::directory_iterator());
  };
  const auto before = descriptors();
  const SftpOptions noting = by("echo $$ > process; exec " + sftp_server);
  EXPECT_EQ(outcome(noting), "read");
  EXPECT_EQ(::kill(std::stoi(TempFolder::read("process")), 0), -1) << "the server has ended, and is no zombie";
  EXPECT_NE(outcome(noting, "missing"), "read");
  EXPECT_NE(outcome({.command = {"/absent/ssh"}}), "read");
  EXPECT_EQ(descriptors(), before);
}

// --- With connections that end.

struct SftpCut : SftpSource {
  // The first `count` connections end after so many bytes.
  [[nodiscard]] SftpOptions cut(int count, std::size_t bytes) const {
    return by(
        fmt::format("echo >> starts; if [ $(wc -l < starts) -le {} ]; then serve | cut {}; echo lost >&2; "
                    "else serve; fi",
                    count, bytes));
  }
  [[nodiscard]] auto starts() const { return TempFolder::read("starts").size(); }
  static constexpr std::size_t after_opening = 60'000;  // within the answers to the read of outcome()
};

TEST_F(SftpCut, ALostConnectionIsMadeOnceMore) {
  EXPECT_EQ(outcome(cut(1, after_opening)), "read");
  EXPECT_EQ(starts(), 2u);
}

TEST_F(SftpCut, GoesOnBehindWhatHasCome) {
  const auto source = value_of(open_ssh(url(), cut(1, 200'000)));
  std::string all(text_.size(), '?');
  EXPECT_EQ(message_of(read_at(*source, 0, all)), "");
  EXPECT_TRUE(all == text_);
  EXPECT_EQ(starts(), 2u);
}

TEST_F(SftpCut, ASecondLossIsAnErrorOfThatReadAlone) {
  const auto source = value_of(open_ssh(url(), cut(2, after_opening)));
  EXPECT_EQ(outcome(*source), url() + ": lost");
  EXPECT_EQ(starts(), 2u);
  EXPECT_EQ(outcome(*source), "read");
}

TEST_F(SftpCut, AFailureToConnectAnewIsTheLast) {
  const auto source = value_of(open_ssh(url(), by(fmt::format("echo >> starts; if [ $(wc -l < starts) -eq 1 ]; then "
                                                              "serve | cut {}; else echo away. >&2; fi",
                                                              after_opening))));
  for (int i = 0; i < 2; ++i) EXPECT_EQ(outcome(*source), url() + ": away: try `ssh host` first");
  EXPECT_EQ(starts(), 2u);
}

TEST_F(SftpCut, AFileThatWasReplacedIsRefused) {
  const auto read_after = [&](const std::string& text, int later) {
    write("data", text_);
    write("starts", "");
    const auto source = value_of(open_ssh(url(), cut(1, after_opening)));
    write("data", text);
    std::filesystem::last_write_time(path("data"),
                                     std::filesystem::file_time_type::clock::now() + std::chrono::hours(later));
    return outcome(*source);
  };
  const std::string changed = url() + ": the file changed on the server while it was open";
  EXPECT_EQ(read_after(text_ + "more", 0), changed);
  EXPECT_EQ(read_after(random_text(text_.size(), 2), 1), changed);
  EXPECT_EQ(read_after("", 0), changed);
}

TEST_F(SftpCut, AStalledConnectionCountsAsLost) {
  SftpOptions options =
      by(fmt::format("echo >> starts; if [ $(wc -l < starts) -eq 1 ]; then serve | (pass {}; "
                     "cat > /dev/null); else serve; fi",
                     after_opening));
  options.stall_timeout = milliseconds(3000);  // a busy machine takes its time, too
  EXPECT_EQ(outcome(options), "read");
  EXPECT_EQ(starts(), 2u);
}

// One of the threads that wait receives for both. The one that is interrupted leaves it to the other.
TEST_F(SftpCut, AWaitIsInterruptedAndOthersGoOn) {
  for (const std::size_t interrupted : {0u, 1u}) {
    std::filesystem::remove(path("go"));
    const auto source = value_of(open_ssh(
        url(), by(fmt::format("serve | (pass {}; while [ ! -e go ]; do sleep .01; done; exec cat)", after_opening))));
    std::array<std::stop_source, 2> stops;
    std::array<std::string, 2> outcomes;
    std::vector<std::thread> threads;
    for (const std::size_t t : {0u, 1u})
      threads.emplace_back([&, t] {
        const Interruptible interruptible(stops[t].get_token());
        outcomes[t] = outcome(*source);
      });
    stops[interrupted].request_stop();
    threads[interrupted].join();
    EXPECT_EQ(outcomes[interrupted], url() + ": interrupted");
    write("go", "");
    threads[1 - interrupted].join();
    EXPECT_EQ(outcomes[1 - interrupted], "read");
  }
}

TEST_F(SftpTest, ASilentServerIsLeftWhenAWaitForItIsInterrupted) {
  const SftpOptions silent = by("echo $$ > process; exec cat > /dev/null");
  std::stop_source stop;
  std::string outcome_of_wait;
  std::thread opener([&] {
    const Interruptible interruptible(stop.get_token());
    outcome_of_wait = outcome(silent);
  });
  EXPECT_TRUE(becomes([&] { return TempFolder::read("process").ends_with('\n'); }));
  stop.request_stop();
  opener.join();
  EXPECT_EQ(outcome_of_wait, url() + ": interrupted");
  EXPECT_EQ(::kill(std::stoi(TempFolder::read("process")), 0), -1);
}

TEST_F(SftpTest, AServerThatDoesNotEndIsEnded) {
  SftpOptions deaf = by("trap '' TERM; echo $$ > process; while :; do sleep .1; done");
  deaf.connect_timeout = milliseconds(200);
  EXPECT_EQ(outcome(deaf), url() + ": no answer: try `ssh host` first");
  EXPECT_EQ(::kill(std::stoi(TempFolder::read("process")), 0), -1);
}

// --- With servers that misbehave.

TEST_F(SftpTest, AnswersMayComeInAnyOrderAndShort) {
  const std::string head = text_.substr(0, head_bytes);
  const auto piece = [&](std::size_t offset, std::size_t bytes) { return text_.substr(offset, bytes); };
  const std::string last = data_answer(4, piece(132'868, 32'668));
  const std::string later = data_answer(3, piece(132'768, 100)) + data_answer(2, piece(100'000, 32'768));
  const auto source =
      value_of(open_ssh(url(), sending(opening_answers(text_.size()) + data_answer(1, head),
                                       {{.reads = 3, .answers = later}, {.reads = 1, .answers = last}})));
  std::string out(65'536, '?');
  EXPECT_EQ(message_of(read_at(*source, 100'000, out)), "");
  EXPECT_TRUE(out == piece(100'000, 65'536));
}

TEST_F(SftpTest, WhatBreaksTheProtocolIsRefused) {
  const std::string open = opening_answers(text_.size()), head = data_answer(1, text_.substr(0, head_bytes));
  const std::string begun = version_answer() + handle_answer(1);
  const std::vector<std::pair<std::string, std::string>> refusals = {
      {version_answer(2), "version 2 of SFTP"},
      {version_answer(0xffffffff), "version 4294967295"},
      {handle_answer(1), "something else"},
      {"Welcome to the machine\n", "a text in place of SFTP"},
      {sftp_number(0xffffffff) + "x", "a packet of 4294967295 bytes"},
      {version_answer() + handle_answer(2), "something else"},
      {version_answer() + handle_answer(1, std::string(300, 'h')), "a handle is too long"},
      {version_answer() + status_answer(1, 3), "permission denied"},
      {version_answer() + status_answer(1, 77, "no\nway\033[31m"), "the server answers 77: no?way?[31m"},
      {begun + attributes_answer(2, 10, 0040755), "not a regular file"},
      {begun + sftp_packet(105, 2, sftp_number(0)), "does not tell the size"},
      {begun + attributes_answer(3, 10), "something else"},
      {open + data_answer(1, std::string(head_bytes + 1, 'x')), "more bytes than were asked for"},
      {open + data_answer(9, "x"), "nobody asked for"},
      {open + data_answer(1, ""), "without bytes"},
      {open + sftp_packet(103, 1, sftp_number(1000) + "x"), "ends too soon"},
      {open + sftp_packet(200, 1), "type 200"},
      {open + status_answer(1, 1), "became shorter"},
      {open + head + head, "nobody asked for"},
  };
  for (const auto& [answers, reason] : refusals) {
    const std::string message = outcome(sending(answers));
    EXPECT_THAT(message, StartsWith(url() + ": ")) << reason;
    EXPECT_THAT(message, HasSubstr(reason));
    EXPECT_THAT(message, Not(HasSubstr("\n")));
  }
}

TEST_F(SftpTest, ARefusalFailsThatReadAlone) {
  const std::string head = data_answer(1, text_.substr(0, head_bytes));
  const auto source = value_of(open_ssh(
      url(), sending(opening_answers(text_.size()) + head, {{.reads = 2, .answers = status_answer(2, 4, "Failure")},
                                                            {.reads = 1, .answers = data_answer(3, "x")}})));
  std::string out(1, '?');
  EXPECT_EQ(message_of(read_at(*source, 40'000, out)), url() + ": the server answers 4: Failure");
  EXPECT_EQ(message_of(read_at(*source, 40'000, out)), "");
  EXPECT_EQ(out, "x");
}

// A byte for each request goes on for hours.
TEST_F(SftpTest, EndlessAnswersToOneReadAreEnded) {
  write("answers", opening_answers(text_.size()));
  SftpOptions options =
      by(fmt::format("cat answers; pass {} > /dev/null; while :; do printf '\\0\\0\\0\\12\\147'; "
                     "pass {} | tail -c +6 | head -c 4; printf '\\0\\0\\0\\1x'; done",
                     opening_bytes(), read_bytes));
  options.stall_timeout = milliseconds(200);
  EXPECT_EQ(outcome(options), url() + ": the server does not answer");
}

// --- Without a server.

TEST_F(SftpTest, TheReasonOfSshIsToldInALine) {
  const auto failing = [&](const std::string& line) { return by("printf '" + line + "' >&2; exit 255"); };
  EXPECT_EQ(outcome(failing("a banner\\nme@host: Permission denied (publickey).\\r\\n")),
            url() + ": me@host: Permission denied (publickey): try `ssh host` first");
  EXPECT_EQ(outcome(failing("")), url() + ": the connection ended: try `ssh host` first");
  EXPECT_EQ(outcome(failing("a\\033[31mb")), url() + ": a?[31mb: try `ssh host` first");
  EXPECT_THAT(outcome(by("head -c 10000 /dev/zero | tr '\\\\0' x >&2")), SizeIs(AllOf(Gt(4000u), Lt(4300u))));
  EXPECT_EQ(message_of(open_ssh("ssh://me@host:22/a", failing("no"))),
            "ssh://host:22/a: no: try `ssh -p 22 me@host` first");
  EXPECT_THAT(outcome({.command = {"/absent/ssh"}}), AllOf(StartsWith(url() + ": cannot start /absent/ssh: "),
                                                           HasSubstr("install the package openssh-client")));
}

TEST(SshAddress, HasItsParts) {
  const auto parts = [](const std::string& url) {
    const SshAddress a = value_of(parse_ssh_address(url));
    return fmt::format("{} {} {} {} {}", a.user, a.host, a.port, a.path, a.name);
  };
  EXPECT_EQ(parts("ssh://host/a.svol"), " host  /a.svol ssh://host/a.svol");
  EXPECT_EQ(parts("ssh://me@my-host.org:2222/a/b.svol"),
            "me my-host.org 2222 /a/b.svol ssh://my-host.org:2222/a/b.svol");
  EXPECT_EQ(parts("ssh://me%40there@host/a"), "me@there host  /a ssh://host/a");
  EXPECT_EQ(parts("ssh://host/~/a%20b@c:1?d#e"), " host  a b@c:1?d#e ssh://host/~/a%20b@c:1?d#e");
  EXPECT_EQ(parts("ssh://host/~me/50%.svol"), " host  /~me/50%.svol ssh://host/~me/50%.svol");
  EXPECT_EQ(parts("ssh://[fe80::1%eth0]:22/a"), " fe80::1%eth0 22 /a ssh://[fe80::1%eth0]:22/a");
}

TEST(SshAddress, IsRefusedIfItCouldMeanSomethingElse) {
  const std::vector<std::pair<std::string, std::string>> refusals = {
      {"http://host/a", "ssh://"},
      {"ssh://me:secret@host/a", "ssh://host/a: leave out the password"},
      {"ssh://-oProxyCommand=x/a", "host"},
      {"ssh://me@-oProxyCommand=x/a", "host"},
      {"ssh://-lroot@host/a", "user"},
      {"ssh://a$(x)@host/a", "user"},
      {"ssh://a%0ab@host/a", "user"},
      {"ssh://@host/a", "user"},
      {"ssh://ho`x`st/a", "host"},
      {"ssh://h;x/a", "host"},
      {"ssh://h x/a", "host"},
      {"ssh:///a", "host"},
      {"ssh://[::1/a", "host"},
      {"ssh://[-x]/a", "host"},
      {"ssh://host:/a", "port"},
      {"ssh://host:0/a", "port"},
      {"ssh://host:65536/a", "port"},
      {"ssh://host:2x/a", "port"},
      {"ssh://[::1]22/a", "port"},
      {"ssh://host", "names no file"},
      {"ssh://host/", "names no file"},
      {"ssh://host/~/", "names no file"},
      {"ssh://host/folder/", "names no file"},
      {"ssh://host/a%00b", "%00"},
  };
  for (const auto& [url, reason] : refusals) {
    const auto address = parse_ssh_address(url);
    EXPECT_THAT(address, FailsWith(ErrorCode::invalid_argument, HasSubstr(reason))) << url;
    EXPECT_THAT(message_of(address), Not(HasSubstr("secret")));
    EXPECT_EQ(message_of(open_ssh(url)), message_of(address));
  }
}

TEST(SshCommand, NamesTheHostBehindAllOptions) {
  const auto words = ssh_command(value_of(parse_ssh_address("ssh://me@host:2222/a")), false);
  EXPECT_EQ(words.front(), "ssh");
  EXPECT_THAT(words, Contains("-oBatchMode=yes"));
  EXPECT_THAT(std::vector(words.end() - 8, words.end()),
              ElementsAre("-p", "2222", "-l", "me", "-s", "--", "host", "sftp"));
  EXPECT_THAT(ssh_command(value_of(parse_ssh_address("ssh://host/a")), true), Not(Contains("-oBatchMode=yes")));
}

}  // namespace
}  // namespace splatvol::test
