// The processes that make one file: svbuild alone, or the ranks of an MPI job. Two sources define these functions.
// svbuild links svbuild_alone.cpp, and neither needs nor starts MPI; svbuild-mpi links svbuild_ranks.cpp.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "builder/pipeline/build.h"
#include "builder/sources/source.h"

namespace splatvol {

/// What several processes did together.
struct JointWork {
  bool tells = true;                      // whether this process prints the result: one does
  std::size_t ranks = 1;                  // processes
  std::size_t ranges = 1;                 // of these, that reduced points of their own
  std::uint64_t record_bytes = 0;         // of all points' records
  std::uint64_t sent_bytes = 0;           // between processes
  std::vector<std::uint64_t> owned = {};  // [rank]: bytes of the records that it sorted
  std::vector<std::uint64_t> peaks = {};  // [rank]: bytes of memory, at most
};

/// Prepares this process; called first. If MPI has started svbuild several times, this becomes svbuild-mpi. Ranks but
/// the first print nothing from then on. Returns an exit code if there is nothing more to do, else -1. Fails if ranks
/// have different command lines: a script that is started by MPI may mean them to be separate.
[[nodiscard]] int join_ranks(int& argc, char**& argv);

/// Processes of this build on this machine, which share its memory and its cores.
[[nodiscard]] std::size_t processes_here();

/// Ends what join_ranks() began.
void leave_ranks();

/// Opens the source and builds the file, as build_volume does. All processes return the same status.
[[nodiscard]] Result<BuildReport> build_in_ranks(const std::function<Result<std::unique_ptr<Source>>()>& open,
                                                 std::unique_ptr<Source>& source, const std::string& output,
                                                 const BuildOptions& options, const BuildProgress& progress,
                                                 JointWork& work);

/// Fails if there are several processes: for work that one does.
[[nodiscard]] Status require_one_rank(const char* work);

}  // namespace splatvol
