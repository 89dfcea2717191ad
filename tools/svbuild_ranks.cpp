// svbuild as the ranks of an MPI job.
#include "tools/svbuild_ranks.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <exception>
#include <memory>
#include <new>
#include <span>
#include <string>
#include <vector>

#include "base/printable.h"
#include "base/temporary_names.h"
#include "builder/distributed/joint_build.h"
#include "builder/distributed/ranks.h"
#include "tools/ending.h"

namespace splatvol {
namespace {

std::unique_ptr<Ranks> all_ranks;
int standard_error = STDERR_FILENO;  // also of ranks that are silent

// One rank speaks for all.
void be_silent() {
  const int nowhere = ::open("/dev/null", O_WRONLY | O_CLOEXEC);
  if (nowhere < 0) return;
  standard_error = ::fcntl(STDERR_FILENO, F_DUPFD_CLOEXEC, STDERR_FILENO + 1);
  ::dup2(nowhere, STDOUT_FILENO);
  ::dup2(nowhere, STDERR_FILENO);
  ::close(nowhere);
}

// All ranks find the same: each compares the first one with all.
bool have_one_command(int argc, char** argv) {
  std::string command;
  for (int i = 0; i < argc; ++i) command.append(argv[i]).push_back('\0');
  const std::vector<Bytes> commands = all_ranks->gather_all(std::as_bytes(std::span(command)));
  return std::ranges::all_of(commands, [&](const Bytes& other) { return other == commands[0]; });
}

// What the libraries throw leaves the other ranks waiting: this ends them too.
[[noreturn]] void end_all(const char* message) {
  ::dup2(standard_error, STDERR_FILENO);
  say("svbuild", message);
  remove_temporaries();
  Ranks::abandon();
}

std::uint64_t peak_memory() {
  rusage usage{};
  return ::getrusage(RUSAGE_SELF, &usage) == 0 ? static_cast<std::uint64_t>(usage.ru_maxrss) * 1024 : 0;
}

}  // namespace

int join_ranks(int& argc, char**& argv) {
  auto started = Ranks::start(argc, argv);
  if (!started) {
    say("svbuild", started.error().message);
    return 1;
  }
  all_ranks = std::move(*started);
  if (!all_ranks->is_first()) be_silent();
  if (have_one_command(argc, argv)) return -1;
  say("svbuild", "the ranks have different command lines; leave out MPI's launcher to build separate files");
  leave_ranks();
  return 2;
}

std::size_t processes_here() { return all_ranks->neighbours(); }

void leave_ranks() { all_ranks.reset(); }

Result<BuildReport> build_in_ranks(const std::function<Result<std::unique_ptr<Source>>()>& open,
                                   std::unique_ptr<Source>& source, const std::string& output,
                                   const BuildOptions& options, const BuildProgress& progress, JointWork& work) try {
  if (options.boundary_triangles > 0) SPLATVOL_TRY(require_one_rank("--boundary"));
  const BuildProgress silent = [](const char*, double) {};
  SPLATVOL_TRY_ASSIGN(report, build_volume_together(*all_ranks, open, source, output, options,
                                                    all_ranks->is_first() ? progress : silent));
  work = {all_ranks->is_first(),
          report.ranks,
          report.ranges,
          report.record_bytes,
          report.sent_bytes,
          report.owned,
          gather_values(*all_ranks, peak_memory())};
  return report.build;
} catch (const std::bad_alloc&) {
  end_all("not enough memory");
} catch (const std::exception& error) {
  end_all(one_line(error.what()).c_str());
}

Status require_one_rank(const char* work) {
  if (all_ranks->size() == 1) return {};
  return fail(ErrorCode::unsupported, "{} is work of one process: start svbuild without MPI", work);
}

}  // namespace splatvol
