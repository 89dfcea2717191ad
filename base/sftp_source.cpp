#include "base/sftp_source.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <condition_variable>
#include <cstdlib>
#include <mutex>
#include <optional>
#include <string_view>
#include <type_traits>
#include <utility>

#include "base/interruption.h"
#include "base/program.h"
#include "base/server_file.h"
#include "base/sftp_protocol.h"

namespace splatvol {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr std::string_view scheme = "ssh://";
constexpr std::size_t received_bytes = 128u << 10;

// Decodes %20 and the like. Other signs stay.
std::string decoded(std::string_view text) {
  std::string result;
  for (std::size_t i = 0; i < text.size(); ++i) {
    unsigned value = 0;
    const std::string_view digits = text.substr(i, 3);
    const char* const end = digits.data() + digits.size();
    if (digits.size() == 3 && digits[0] == '%' && std::from_chars(digits.data() + 1, end, value, 16).ptr == end) {
      result += static_cast<char>(value);
      i += 2;
    } else {
      result += text[i];
    }
  }
  return result;
}

// Whether ssh, and a shell that its configuration starts (ProxyCommand), take a word for a name.
bool is_plain(std::string_view word, std::string_view signs) {
  const auto is_allowed = [&](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || signs.find(c) != signs.npos;
  };
  return !word.starts_with('-') && std::ranges::all_of(word, is_allowed);
}

// Takes HOST[:PORT] apart. Returns false if a host has other signs than it may.
bool take_host(std::string_view text, SshAddress& address) {
  const bool is_ipv6 = text.starts_with('[') && text.find(']') != text.npos;
  const std::size_t end = is_ipv6 ? text.find(']') + 1 : std::min(text.find(':'), text.size());
  address.host = is_ipv6 ? text.substr(1, end - 2) : text.substr(0, end);
  if (address.host.empty() || !is_plain(address.host, is_ipv6 ? ".:%" : "._-+")) return false;
  if (end < text.size()) address.port = text[end] == ':' && end + 1 < text.size() ? text.substr(end + 1) : "?";
  return true;
}

bool is_port(std::string_view text) {
  unsigned port = 0;
  const char* const end = text.data() + text.size();
  return std::from_chars(text.data(), end, port).ptr == end && port >= 1 && port <= 65535;
}

// Whether ssh can ask at a terminal, which a program in the background may not use, or by a window.
bool can_ask() {
  if (std::getenv("SSH_ASKPASS")) return true;
  const int terminal = ::open("/dev/tty", O_RDWR | O_NOCTTY | O_CLOEXEC);
  if (terminal < 0) return false;
  const bool is_ours = ::tcgetpgrp(terminal) == ::getpgrp();
  ::close(terminal);
  return is_ours;
}

// Identifies the file on the server, to notice a change.
struct Content {
  std::uint64_t size;
  std::optional<std::uint32_t> changed;
  bool operator==(const Content&) const = default;
};

// A connection with an open file. Errors are without the file's name.
class SftpSession {
 public:
  [[nodiscard]] static Result<std::unique_ptr<SftpSession>> open(const SshAddress& address,
                                                                 const SftpOptions& options) {
    auto program = ConnectedProgram::start(options.command.empty() ? ssh_command(address, can_ask()) : options.command);
    if (!program) return fail(ErrorCode::io, "{}: install the package openssh-client", program.error().message);
    std::unique_ptr<SftpSession> session(new SftpSession(std::move(*program), Clock::now() + options.connect_timeout));
    SPLATVOL_TRY(session->begin(address));
    SPLATVOL_TRY(session->open_file(address.path));
    return session;
  }

  [[nodiscard]] const Content& content() const { return content_; }
  [[nodiscard]] const std::string& handle() const { return handle_; }

  // Sends packets, and those that were left.
  void send(std::string_view packets) {
    to_send_ += packets;
    if (!to_send_.empty()) program_->send(to_send_);
  }
  [[nodiscard]] bool has_to_send() const { return !to_send_.empty(); }

  // Waits for bytes. Fails if no more will come. Another thread may send meanwhile.
  Status receive(bool has_to_send) {
    const auto got = program_->receive(received_, interruption_delay, has_to_send);
    if (!got) {
      const std::string line = program_->last_line();
      return fail(ErrorCode::io, "{}", line.empty() ? "the connection ended" : line);
    }
    answers_.add(std::span(received_).first(*got));
    return {};
  }

  [[nodiscard]] Result<std::optional<SftpAnswer>> next() { return answers_.next(); }

 private:
  SftpSession(std::unique_ptr<ConnectedProgram> program, Clock::time_point deadline)
      : program_(std::move(program)), deadline_(deadline), received_(received_bytes) {}

  // Until the server answers, ssh itself is what fails.
  Status begin(const SshAddress& address) {
    send(sftp_init());
    const auto version = answer<SftpVersion>();
    if (!version && version.error().code == ErrorCode::io && !is_interrupted()) {
      std::string_view reason = version.error().message;
      while (reason.ends_with('.')) reason.remove_suffix(1);
      return fail(ErrorCode::io, "{}: try `ssh {}{}{}{}` first", reason, address.port.empty() ? "" : "-p ",
                  address.port.empty() ? "" : address.port + " ", address.user.empty() ? "" : address.user + "@",
                  address.host);
    }
    if (!version) return tl::unexpected(version.error());
    if (version->version != 3)
      return fail(ErrorCode::unsupported, "the server speaks version {} of SFTP instead of 3", version->version);
    return {};
  }

  Status open_file(const std::string& path) {
    send(sftp_open(1, path));
    SPLATVOL_TRY_ASSIGN(opened, answer<SftpHandle>(1));
    handle_ = opened.handle;
    send(sftp_fstat(2, handle_));
    SPLATVOL_TRY_ASSIGN(attributes, answer<SftpAttributes>(2));
    if (attributes.permissions && !S_ISREG(*attributes.permissions)) return fail(ErrorCode::io, "not a regular file");
    if (!attributes.size) return fail(ErrorCode::unsupported, "the server does not tell the size of the file");
    content_ = {*attributes.size, attributes.changed};
    return {};
  }

  // Waits for an answer of a kind.
  template <class Answer>
  Result<Answer> answer(std::uint32_t id = 0) {
    for (;;) {
      SPLATVOL_TRY_ASSIGN(came, answers_.next());
      if (came) {
        const auto* status = std::get_if<SftpStatus>(&*came);
        if (status && status->id == id && id > 0) return fail(ErrorCode::io, "{}", text_of(*status));
        const auto* wanted = std::get_if<Answer>(&*came);
        if constexpr (!std::is_same_v<Answer, SftpVersion>) wanted = wanted && wanted->id == id ? wanted : nullptr;
        if (wanted) return *wanted;
        return fail(ErrorCode::invalid_data, "the server breaks the protocol SFTP: it answers something else");
      }
      if (is_interrupted()) return fail(ErrorCode::io, "interrupted");
      if (Clock::now() > deadline_) return fail(ErrorCode::io, "no answer");
      SPLATVOL_TRY(receive(has_to_send()));
      send("");
    }
  }

  std::unique_ptr<ConnectedProgram> program_;
  const Clock::time_point deadline_;  // of the beginning
  std::vector<std::byte> received_;
  SftpAnswers answers_;
  std::string to_send_, handle_;
  Content content_{};
};

// One of the threads that wait for reads works for all: it connects, and receives.
class SftpSource final : public ByteSource {
 public:
  SftpSource(SshAddress address, SftpOptions options) : address_(std::move(address)), options_(std::move(options)) {}

  std::uint64_t size() const override { return content_->size; }
  const std::string& name() const override { return address_.name; }
  std::uint64_t cheap_gap() const override { return gap_on_servers; }

  // Must be called first.
  Status open() {
    SPLATVOL_TRY(connect_first());
    std::vector<std::byte> head(std::min<std::uint64_t>(FileHead::usual_bytes, size()));
    SPLATVOL_TRY(read(0, head));
    head_.keep(std::move(head));
    return {};
  }

  Status read(std::uint64_t offset, std::span<std::byte> out) override {
    SPLATVOL_TRY(check_range(*this, offset, out.size()));
    const Part rest = head_.fill(offset, out);
    return rest.out.empty() ? Status{} : transfer({&rest, 1});
  }

  bool may_read_parts() const override { return true; }

  Result<bool> read_parts(std::span<const Part> parts) override {
    for (const Part& part : parts) SPLATVOL_TRY(check_range(*this, part.offset, part.out.size()));
    SPLATVOL_TRY(transfer(parts));
    return true;
  }

 private:
  using Lock = std::unique_lock<std::mutex>;

  Status connect_first() {
    Lock lock(mutex_);
    connect(lock);
    if (failure_) return fail_in(name(), *failure_);
    return session_ ? Status{} : fail(ErrorCode::io, "{}: interrupted", name());
  }

  Status transfer(std::span<const Part> parts) {
    SftpReads::Group group;
    Lock lock(mutex_);
    if (failure_) return fail_in(name(), *failure_);
    if (threads_++ == 0) last_end_ = Clock::now();
    for (const Part& part : parts) reads_.add(part.offset, part.out, group);
    send_reads();
    while (group.left > 0) {
      if (is_interrupted()) {
        reads_.forget(group);
        group.failure = Error{ErrorCode::io, "interrupted"};
      } else if (is_working_) {
        changed_.wait_for(lock, interruption_delay);
      } else {
        is_working_ = true;
        session_ ? work(lock) : connect(lock);
        is_working_ = false;
        changed_.notify_all();
      }
    }
    --threads_;
    if (group.failure) return fail_in(name(), *group.failure);
    return {};
  }

  // Connects. A failure is the end of all reads, unless it is this thread's interruption.
  void connect(Lock& lock) {
    lock.unlock();
    auto session = SftpSession::open(address_, options_);
    if (session && content_ && (*session)->content() != *content_) session = fail(ErrorCode::io, "{}", file_changed);
    lock.lock();
    if (!session && is_interrupted()) return;
    if (!session) return give_up(session.error());
    session_ = std::move(*session);
    content_ = session_->content();
    last_end_ = Clock::now();
    send_reads();
  }

  // Waits for answers, and takes them.
  void work(Lock& lock) {
    const bool has_to_send = session_->has_to_send();
    lock.unlock();
    const Status received = session_->receive(has_to_send);
    lock.lock();
    Status taken;
    for (bool are_more = true; are_more && taken;) {
      const auto answer = session_->next();
      are_more = answer && *answer;
      if (are_more) {
        const auto ended = reads_.take(**answer);
        if (ended && *ended) last_end_ = Clock::now();
        if (!ended) taken = tl::unexpected(ended.error());
      } else if (!answer) {
        taken = tl::unexpected(answer.error());
      }
    }
    if (!taken) return end_session(lock, [&] { give_up(taken.error()); });
    if (!received) return end_session(lock, [&] { reads_.lose_answers(received.error()); });
    if (Clock::now() - last_end_ > options_.stall_timeout)
      return end_session(lock, [&] { reads_.lose_answers(Error{ErrorCode::io, "the server does not answer"}); });
    send_reads();
  }

  // Ssh takes a while to end.
  template <class Tell>
  void end_session(Lock& lock, const Tell& tell) {
    auto ended = std::move(session_);
    tell();
    lock.unlock();
    ended.reset();
    lock.lock();
  }

  void give_up(const Error& reason) {
    failure_ = reason;
    reads_.fail_all(reason);
  }

  void send_reads() {
    if (session_) session_->send(reads_.take_packets(session_->handle()));
  }

  const SshAddress address_;
  const SftpOptions options_;
  std::optional<Content> content_;  // constant once open
  FileHead head_;
  std::mutex mutex_;  // of all below
  std::condition_variable changed_;
  SftpReads reads_;
  std::unique_ptr<SftpSession> session_;  // null: not connected. Only the thread that works replaces it, or receives
  bool is_working_ = false;               // a thread does
  std::size_t threads_ = 0;               // that wait
  Clock::time_point last_end_;            // of a read
  std::optional<Error> failure_;          // of all later reads
};

}  // namespace

Result<SshAddress> parse_ssh_address(const std::string& url) {
  if (!url.starts_with(scheme)) return fail(ErrorCode::invalid_argument, "not an address that begins with ssh://");
  const std::string_view whole = std::string_view(url).substr(scheme.size());
  const std::size_t slash = std::min(whole.find('/'), whole.size());
  const std::size_t at = whole.substr(0, slash).rfind('@');
  const std::string_view user = at == whole.npos ? std::string_view() : whole.substr(0, at);
  SshAddress address{.user = decoded(user), .path = decoded(whole.substr(slash))};
  address.name = fmt::format("{}{}", scheme, whole.substr(at + 1));
  const auto refuse = [&](std::string_view what) {
    return fail(ErrorCode::invalid_argument, "{}: {}", address.name, what);
  };
  if (user.find(':') != user.npos) return refuse("leave out the password: ssh asks for it");
  if (at == 0 || !is_plain(address.user, "._-+@%=,"))
    return refuse("the user has signs that are not allowed: name the user in ~/.ssh/config");
  if (!take_host(whole.substr(at + 1, slash - (at + 1)), address))
    return refuse("the host has signs that are not allowed: give it a name in ~/.ssh/config");
  if (!address.port.empty() && !is_port(address.port)) return refuse("a port is a number from 1 to 65535");
  if (address.path.starts_with("/~/")) address.path.erase(0, 3);
  if (address.path.empty() || address.path.ends_with('/')) return refuse("names no file: ssh://HOST/PATH");
  if (address.path.find('\0') != std::string::npos) return refuse("a path has no %00");
  return address;
}

std::vector<std::string> ssh_command(const SshAddress& address, bool may_ask) {
  // Without what the user's configuration adds for terminals. A master that is there is used, but none stays behind.
  std::vector<std::string> words = {"ssh",
                                    "-a",
                                    "-x",
                                    "-oClearAllForwardings=yes",
                                    "-oControlMaster=no",
                                    "-oPermitLocalCommand=no",
                                    "-oRemoteCommand=none",
                                    "-oRequestTTY=no"};
  if (!may_ask) words.emplace_back("-oBatchMode=yes");
  if (!address.port.empty()) words.insert(words.end(), {"-p", address.port});
  if (!address.user.empty()) words.insert(words.end(), {"-l", address.user});
  words.insert(words.end(), {"-s", "--", address.host, "sftp"});
  return words;
}

Result<std::unique_ptr<ByteSource>> open_ssh(const std::string& url, const SftpOptions& options) {
  SPLATVOL_TRY_ASSIGN(address, parse_ssh_address(url));
  auto source = std::make_unique<SftpSource>(std::move(address), options);
  SPLATVOL_TRY(source->open());
  return source;
}

}  // namespace splatvol
