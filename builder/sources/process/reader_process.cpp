#include "builder/sources/process/reader_process.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <fstream>
#include <map>
#include <optional>
#include <system_error>
#include <utility>

#include "builder/sources/process/input_bytes.h"
#include "builder/sources/process/messages.h"

extern char** environ;

namespace splatvol {
namespace {

/// Returns the bytes that a process has read so far; empty if the system does not tell.
std::optional<std::uint64_t> bytes_read_by(pid_t process) {
  std::ifstream file(fmt::format("/proc/{}/io", process));
  std::string name;
  std::uint64_t bytes = 0;
  if (file >> name >> bytes && name == "rchar:") return bytes;
  return std::nullopt;
}

Result<pid_t> spawn(const ReaderProcessOptions& options, int socket) {
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  // The copy outlives exec, unlike all other descriptors of this program. A descriptor onto itself stays open too.
  constexpr int socket_of_reader = 3;
  ::posix_spawn_file_actions_adddup2(&actions, socket, socket_of_reader);
  // Its libraries print lines of their own. An error is one line, so theirs go.
  ::posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
  std::array<std::string, 4> words = {options.program, std::to_string(socket_of_reader), std::to_string(options.memory),
                                      std::to_string(options.threads)};
  std::array<char*, 5> arguments = {words[0].data(), words[1].data(), words[2].data(), words[3].data(), nullptr};
  pid_t process = 0;
  const int error = ::posix_spawn(&process, words[0].c_str(), &actions, nullptr, arguments.data(), environ);
  ::posix_spawn_file_actions_destroy(&actions);
  if (error != 0)
    return fail(ErrorCode::io, "cannot start {}, which reads files of other formats: {}", options.program,
                std::system_category().message(error));
  return process;
}

/// For a request, or an answer, of no more than its beginning.
Status nothing(Channel&) { return {}; }

auto put_inputs(const std::vector<std::string>& inputs, const SourceOptions& options) {
  return [&](Channel& channel) -> Status {
    SPLATVOL_TRY(channel.put(inputs));
    return put(channel, options);
  };
}

}  // namespace

/// The running process. After a failure it is gone.
class ReaderProcess::Process {
 public:
  [[nodiscard]] static Result<std::shared_ptr<Process>> start(const ReaderProcessOptions& options,
                                                              std::shared_ptr<ReadFiles> files) {
    std::array<int, 2> sockets{};
    if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, sockets.data()) != 0)
      return fail(ErrorCode::io, "socketpair: {}", std::system_category().message(errno));
    auto spawned = spawn(options, sockets[1]);
    ::close(sockets[1]);
    if (!spawned) {
      ::close(sockets[0]);
      return tl::unexpected(spawned.error());
    }
    return std::shared_ptr<Process>(new Process(options, *spawned, sockets[0], std::move(files)));
  }

  ~Process() { end(); }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  [[nodiscard]] bool has_ended() const { return !channel_; }

  /// Sends a request, and receives its answer by `get_answer`. Errors of the process itself begin with `name`.
  template <class Put, class Get>
  Status ask(const std::string& name, ReaderRequest request, std::uint64_t source, const Put& put_rest,
             const Get& get_answer) {
    if (!channel_) return fail(ErrorCode::io, "{}: the process that read it has ended", name);
    std::optional<Error> refusal;
    begin_wait();
    const Status talked = [&]() -> Status {
      SPLATVOL_TRY(channel_->put_all(request, source));
      SPLATVOL_TRY(put_rest(*channel_));
      SPLATVOL_TRY(channel_->flush());
      bool refused = false;
      SPLATVOL_TRY(channel_->get(refused));
      return refused ? get(*channel_, refusal.emplace()) : get_answer(*channel_);
    }();
    count_time();
    if (!talked) return fail_in(name, explain(talked.error()));
    return refusal ? Status(tl::unexpected(std::move(*refusal))) : Status{};
  }

  /// Says what the next request reads.
  void add_input(const std::vector<std::string>& inputs) { ++inputs_[inputs].uses; }

  /// Notes what was opened.
  void note(OpenedFiles files) {
    files_->opened.insert(files.opened.begin(), files.opened.end());
    files_->missing.insert(files.missing.begin(), files.missing.end());
    files_->are_all = files_->are_all && files.are_all;
  }

  /// Says that a source is not used any more.
  void close(std::uint64_t source) {
    if (!channel_) return;
    begin_wait();
    const bool sent = channel_->put_all(ReaderRequest::close, source) && channel_->flush();
    if (!sent) end();
  }

 private:
  Process(const ReaderProcessOptions& options, pid_t process, int socket, std::shared_ptr<ReadFiles> files)
      : options_(options),
        process_(process),
        files_(std::move(files)),
        channel_(std::in_place, socket, options.memory, [this] { return wait(); }) {}

  void begin_wait() {
    last_look_ = std::chrono::steady_clock::now();
    silence_ = {};
  }

  /// Adds the time since the last look. A program that is stopped for a while does not wait then.
  void count_time() {
    using std::chrono::steady_clock;
    const auto now = steady_clock::now();
    const auto time = std::min<steady_clock::duration>(now - last_look_, std::chrono::seconds(2));
    last_look_ = now;
    waited_ += time;
    silence_ += time;
  }

  /// Bytes that it reads or sends are a sign that it gets on.
  Status wait() {
    count_time();
    if (const auto bytes = bytes_read_by(process_)) bytes_read_ = *bytes;
    if (bytes_read_ + channel_->received() != bytes_moved_) silence_ = {};
    bytes_moved_ = bytes_read_ + channel_->received();
    if (options_.progress) tell_progress();
    if (silence_ >= options_.patience)
      return fail(ErrorCode::invalid_data, "nothing comes of reading it for {} s: damaged, or its disk does not answer",
                  options_.patience.count());
    return check_work();
  }

  void tell_progress() {
    const double all = bytes_of_inputs();
    options_.progress(all > 0 ? std::min(1.0, static_cast<double>(bytes_read_) / all) : 0);
  }

  /// Bytes and seconds that the process may take for inputs of so many bytes.
  struct Work {
    double bytes, seconds;
  };
  [[nodiscard]] Work work_for(double input_bytes) const {
    return {options_.factor * (0x1p30 + 64 * input_bytes), options_.factor * (600 + input_bytes / 1e6)};
  }

  /// Looks at the inputs only when it depends on their size: a folder may hold many files.
  Status check_work() {
    const Work done{static_cast<double>(bytes_read_), std::chrono::duration<double>(waited_).count()};
    const auto is_within = [&](const Work& most) { return done.bytes <= most.bytes && done.seconds <= most.seconds; };
    if (is_within(work_for(0))) return {};
    const Work most = work_for(bytes_of_inputs());
    if (is_within(most)) return {};
    const std::string what = done.bytes > most.bytes
                                 ? fmt::format("more than {:.3g} MB were read for it", most.bytes / 1e6)
                                 : fmt::format("reading it takes longer than {:.3g} s", most.seconds);
    return fail(ErrorCode::invalid_data,
                "{}, which is too much for its size: damaged, or made to take for ever; if it is sound, add "
                "'--read-factor {:.3g}'",
                what, 4 * options_.factor);
  }

  double bytes_of_inputs() {
    double sum = 0;
    for (auto& [inputs, input] : inputs_) {
      if (!input.bytes) input.bytes = input_bytes(inputs);
      sum += static_cast<double>(*input.bytes) * input.uses;
    }
    return sum;
  }

  /// Ends the process, and says why it failed.
  Error explain(const Error& error) {
    const int status = end();
    if (error.code != ErrorCode::io) return error;
    constexpr int not_loaded = 127;  // the status of the system's loader
    if (WIFEXITED(status) && WEXITSTATUS(status) == not_loaded)
      return {ErrorCode::io, fmt::format("the libraries of {} do not load: one is missing, or a limit on address space "
                                         "(ulimit -v) is too low",
                                         options_.program)};
    if (!WIFSIGNALED(status)) return {ErrorCode::io, "the process that read it ended too early"};
    if (WTERMSIG(status) == SIGKILL)
      return {ErrorCode::io, "the process that read it was killed: perhaps the machine has too little memory"};
    return {ErrorCode::invalid_data,
            fmt::format("the library of its format crashes on it: it is damaged, or a file that it names is, or it "
                        "takes more than {} MiB of memory",
                        options_.memory >> 20)};
  }

  /// Returns the process's status, as waitpid does.
  int end() {
    if (!channel_) return 0;
    channel_.reset();
    // A process that has crashed keeps its own signal.
    int status = 0;
    if (::waitpid(process_, &status, WNOHANG) == process_) return status;
    // The kernel closes the socket before it has ended the process.
    for (int i = 0; i < 100; ++i) {
      ::usleep(1000);
      if (::waitpid(process_, &status, WNOHANG) == process_) return status;
    }
    ::kill(process_, SIGKILL);
    while (::waitpid(process_, &status, 0) < 0 && errno == EINTR) {
    }
    return status;
  }

  ReaderProcessOptions options_;
  pid_t process_;
  std::shared_ptr<ReadFiles> files_;
  std::optional<Channel> channel_;  // none: the process has ended

  struct Input {
    double uses = 0;
    std::optional<std::uint64_t> bytes;  // once they are known
  };
  std::map<std::vector<std::string>, Input> inputs_;
  std::uint64_t bytes_read_ = 0;
  std::uint64_t bytes_moved_ = 0;                  // read and sent
  std::chrono::steady_clock::duration waited_{};   // in all
  std::chrono::steady_clock::duration silence_{};  // of the current wait: without a byte moved
  std::chrono::steady_clock::time_point last_look_;
};

class ProcessSource final : public Source {
 public:
  ProcessSource(std::shared_ptr<ReaderProcess::Process> process, std::uint64_t number, std::string name)
      : process_(std::move(process)), number_(number), name_(std::move(name)) {}
  ~ProcessSource() override { process_->close(number_); }
  ProcessSource(const ProcessSource&) = delete;
  ProcessSource& operator=(const ProcessSource&) = delete;

  Status open(const std::vector<std::string>& inputs, const SourceOptions& options) {
    return process_->ask(name_, ReaderRequest::open, number_, put_inputs(inputs, options),
                         [&](Channel& channel) { return get_state(channel); });
  }

  Result<std::unique_ptr<Piece>> next() override {
    auto piece = std::make_unique<Piece>();
    const auto put = [&](Channel& channel) { return channel.put_all(lends_, whole_cells_); };
    const auto take = [&](Channel& channel) -> Status {
      SPLATVOL_TRY(get_state(channel));
      bool is_there = false;
      SPLATVOL_TRY(channel.get(is_there));
      if (is_there) return get(channel, *piece, state_.attributes.size());
      piece.reset();
      return {};
    };
    SPLATVOL_TRY(process_->ask(name_, ReaderRequest::next, number_, put, take));
    return piece;
  }

  Result<std::optional<Box>> bounds() override {
    std::optional<Box> box;
    SPLATVOL_TRY(process_->ask(name_, ReaderRequest::bounds, number_, nothing,
                               [&](Channel& channel) { return channel.get(box); }));
    return box;
  }

  // If the process fails, so will the next select() or next().
  std::vector<std::uint64_t> part_sizes() override {
    std::vector<std::uint64_t> sizes;
    const Status answered = process_->ask(name_, ReaderRequest::parts, number_, nothing,
                                          [&](Channel& channel) { return channel.get(sizes); });
    return answered ? sizes : std::vector<std::uint64_t>();
  }
  Status select(const std::vector<std::uint64_t>& parts) override {
    return process_->ask(
        name_, ReaderRequest::select, number_, [&](Channel& channel) { return channel.put(parts); }, nothing);
  }
  PieceNumber piece_number() const override { return state_.number; }

  const std::vector<std::string>& attributes() const override { return state_.attributes; }
  std::vector<std::string> units() const override { return state_.units; }
  std::vector<int> components() const override { return state_.components; }
  void lend_values() override { lends_ = true; }
  void tell_whole_cells() override { whole_cells_ = true; }
  std::size_t piece_count() const override { return static_cast<std::size_t>(state_.pieces); }
  std::optional<std::uint64_t> point_count() const override { return state_.points; }
  std::optional<TimeStep> time_step() const override { return state_.step; }
  std::optional<double> stated_time() const override { return state_.time; }
  std::vector<std::string> conversions() const override { return state_.conversions; }
  std::uint64_t left_out_cells() const override { return state_.left_out_cells; }
  bool averages_by_piece() const override { return state_.averages_by_piece; }
  VertexCopies copies() const override { return state_.copies; }
  bool may_have_cells() const override { return state_.may_have_cells; }
  bool brings_material() const override { return state_.brings_material; }
  bool single_precision() const override { return state_.single_precision; }

 private:
  /// The attributes stay those of the first time.
  Status get_state(Channel& channel) {
    SourceState state;
    SPLATVOL_TRY(get(channel, state));
    process_->note(std::exchange(state.files, {}));
    const bool is_first = state_.attributes.empty();
    if (state.units.size() != state.attributes.size() || state.components.size() != state.attributes.size() ||
        (!is_first && state.attributes != state_.attributes))
      return fail(ErrorCode::invalid_data, "the reader process sent other attributes");
    state_ = std::move(state);
    return {};
  }

  std::shared_ptr<ReaderProcess::Process> process_;
  std::uint64_t number_;
  std::string name_;
  SourceState state_;
  bool lends_ = false;
  bool whole_cells_ = false;
};

ReaderProcess::ReaderProcess(ReaderProcessOptions options) : options_(std::move(options)) {}
ReaderProcess::~ReaderProcess() = default;

Status ReaderProcess::start() {
  if (process_ && !process_->has_ended()) return {};
  SPLATVOL_TRY_ASSIGN(process, Process::start(options_, files_));
  process_ = std::move(process);
  return {};
}

Result<std::unique_ptr<Source>> ReaderProcess::open(const std::vector<std::string>& inputs,
                                                    const SourceOptions& options) {
  SPLATVOL_TRY(start());
  auto source = std::make_unique<ProcessSource>(process_, sources_++, inputs.at(0));
  process_->add_input(inputs);
  SPLATVOL_TRY(source->open(inputs, options));
  return source;
}

Result<std::optional<std::vector<ArrayShape>>> ReaderProcess::list_arrays(const std::vector<std::string>& inputs,
                                                                          const SourceOptions& options) {
  SPLATVOL_TRY(start());
  std::optional<std::vector<ArrayShape>> arrays;
  SPLATVOL_TRY(process_->ask(inputs.at(0), ReaderRequest::list, 0, put_inputs(inputs, options),
                             [&](Channel& channel) { return get(channel, arrays); }));
  return arrays;
}

Result<TriangleMesh> ReaderProcess::read_surface(const std::string& path) {
  SPLATVOL_TRY(start());
  TriangleMesh mesh;
  process_->add_input({path});
  SPLATVOL_TRY(process_->ask(
      path, ReaderRequest::surface, 0, [&](Channel& channel) { return channel.put(path); },
      [&](Channel& channel) { return get(channel, mesh); }));
  return mesh;
}

}  // namespace splatvol
