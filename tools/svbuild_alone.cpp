// svbuild as one process.
#include <unistd.h>

#include <array>
#include <cstdlib>

#include "tools/ending.h"
#include "tools/reading.h"
#include "tools/svbuild_ranks.h"
#include "tools/tool.h"

namespace splatvol {
namespace {

// A number that a launcher of MPI jobs gives its processes: the first of these variables that is there.
template <std::size_t count>
long number_of(const std::array<const char*, count>& names, long otherwise) {
  for (const char* name : names)
    if (const char* text = std::getenv(name)) return std::strtol(text, nullptr, 10);
  return otherwise;
}

}  // namespace

// Open MPI, then what MPICH, Intel MPI and SLURM's own launcher set.
int join_ranks(int&, char**& argv) {
  const long size = number_of(std::array{"OMPI_COMM_WORLD_SIZE", "PMI_SIZE"}, 1);
  if (size < 2) return -1;
  ::execv(find_program("svbuild-mpi").c_str(), argv);
  if (number_of(std::array{"OMPI_COMM_WORLD_RANK", "PMI_RANK"}, 0) == 0)
    say("svbuild", "started by MPI, but built without it: svbuild-mpi is not there");
  return 1;
}

std::size_t processes_here() { return 1; }

void leave_ranks() {}

Result<BuildReport> build_in_ranks(const std::function<Result<std::unique_ptr<Source>>()>& open,
                                   std::unique_ptr<Source>& source, const std::string& output,
                                   const BuildOptions& options, const BuildProgress& progress, JointWork&) {
  SPLATVOL_TRY(store(open(), source));
  return build_volume(*source, output, options, progress);
}

Status require_one_rank(const char*) { return {}; }

}  // namespace splatvol
