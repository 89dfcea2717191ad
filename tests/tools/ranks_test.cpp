// svbuild as the ranks of an MPI job: the same bytes as one process makes, within the memory of each rank, and one end
// for all of them where one fails.
#include <fcntl.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/long.h"
#include "tests/support/programs.h"
#include "tests/support/sanitizers.h"

namespace splatvol::test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using ::testing::HasSubstr;

constexpr std::uint64_t mebibyte = 1u << 20;

bool has_mpi() { return std::string_view(SPLATVOL_MPIEXEC) != "" && fs::exists(SPLATVOL_MPIEXEC); }

// A command that starts ranks, all on this machine.
std::string ranks(int count, const std::string& arguments) {
  return SPLATVOL_MPIEXEC " -n " + std::to_string(count) + " " SPLATVOL_BIN "/svbuild " + arguments;
}

// The same, where one rank runs another command than the rest. A shell chooses: mpirun of Open MPI 5.0.7 crashes if it
// is to start several commands.
std::string ranks_but_one(int count, int one, const std::string& of_one, const std::string& of_others) {
  return SPLATVOL_MPIEXEC " -n " + std::to_string(count) +
         " bash -c 'if [[ ${OMPI_COMM_WORLD_RANK:-$PMI_RANK} == " + std::to_string(one) + " ]]; then " + of_one +
         "; else " + of_others + "; fi'";
}

std::vector<pid_t> children_of(pid_t process) {
  std::vector<pid_t> children;
  std::ifstream list("/proc/" + std::to_string(process) + "/task/" + std::to_string(process) + "/children");
  for (pid_t child = 0; list >> child;) children.push_back(child);
  return children;
}

// Returns the number of lines of the program; the launcher has some of its own.
std::ptrdiff_t lines_of(const Outcome& outcome) {
  std::istringstream all(outcome.err);
  std::ptrdiff_t count = 0;
  for (std::string line; std::getline(all, line);) count += line.starts_with("svbuild: ") ? 1 : 0;
  return count;
}

struct RanksTest : ProgramTest {
  void SetUp() override {
    fs::create_directory(path("out"));
    // Open MPI's guards against what a test does; other launchers do not know these names.
    for (const char* name :
         {"OMPI_ALLOW_RUN_AS_ROOT", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "OMPI_MCA_rmaps_base_oversubscribe"})
      ::setenv(name, "1", 1);
    ::setenv("PRTE_MCA_rmaps_default_mapping_policy", ":oversubscribe", 1);  // from version 5 on
    if (is_sanitized) GTEST_SKIP() << "MPI's libraries are not built with sanitizers";
    if (!has_mpi()) GTEST_SKIP() << "built without MPI, or without its launcher: -D SPLATVOL_MPI=ON needs both";
  }

  [[nodiscard]] std::vector<std::string> outputs() const {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(path("out"))) names.push_back(entry.path().filename());
    return names;
  }

  // Points with several attributes, missing values and unusable positions, in files of very different sizes.
  void write_npy_pieces() const {
    std::mt19937_64 random(1);
    std::normal_distribution<double> normal;
    std::vector<int> counts = {250'000, 7, 130'000, 90'000, 120'000};
    if (!is_long()) counts = {60'000, 7, 30'000, 20'000, 30'000};
    for (std::size_t file = 0; file < counts.size(); ++file) {
      std::string header =
          "{'descr': [('x','<f8'),('y','<f8'),('z','<f8'),('p','<f8'),('same','<f8'),('q','<f8')], "
          "'fortran_order': False, 'shape': (" +
          std::to_string(counts[file]) + ",), }";
      while ((10 + header.size() + 1) % 64 != 0) header += ' ';
      header += '\n';
      std::ofstream out(path("p" + std::to_string(file) + ".npy"), std::ios::binary);
      out.write("\x93NUMPY\x01\x00", 8);
      const auto length = static_cast<std::uint16_t>(header.size());
      out.write(reinterpret_cast<const char*>(&length), 2);
      out << header;
      for (int i = 0; i < counts[file]; ++i) {
        const double nan = std::numeric_limits<double>::quiet_NaN();
        std::array<double, 6> row = {normal(random), normal(random), normal(random)};
        row[3] = row[4] = i % 17 == 0 ? nan : row[0] * row[1];
        row[5] = i % 3 == 0 ? std::abs(row[2]) : -0.0;
        if (i == 5) row[0] = std::numeric_limits<double>::infinity();
        out.write(reinterpret_cast<const char*>(row.data()), sizeof row);
      }
    }
  }

  json build_of(int count, const std::string& arguments) const {
    const Outcome outcome = run(ranks(count, arguments + " --threads 1 --json -o out/a.svol"));
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return json::parse(outcome.out).at("ranks");
  }

  // Expects that a build fails with one line, and leaves the old output alone. If a rank waits for ever, ctest's limit
  // ends the test.
  void expect_one_failure(const std::string& command, const std::string& reason) const {
    write("out/a.svol", "");
    expect_done("svbuild gen:points:count=100 -o out/a.svol");
    const std::string before = read("out/a.svol");
    const Outcome outcome = run(command);
    EXPECT_EQ(outcome.code, 1);
    EXPECT_EQ(lines_of(outcome), 1) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr(reason));
    EXPECT_EQ(read("out/a.svol"), before);
    EXPECT_THAT(outputs(), testing::ElementsAre("a.svol"));
  }

  // Kills a rank of a build, and expects that all end and leave nothing. `preload`: a library for the ranks.
  void expect_end_of_all(std::size_t victim, const char* preload) const {
    const pid_t launcher = ::fork();
    if (launcher == 0) {
      for (const int stream : {1, 2}) ::dup2(::open("/dev/null", O_WRONLY), stream);
      const std::string command = std::string("exec env LD_PRELOAD=") + preload +
                                  " " SPLATVOL_BIN
                                  "/svbuild --connectivity boxes gen:points:count=1e8,distribution=vortex";
      ::execl(SPLATVOL_MPIEXEC, SPLATVOL_MPIEXEC, "-n", "3", "sh", "-c",
              (command + " -o " + path("out/a.svol")).c_str(), nullptr);
      ::_exit(127);
    }
    std::vector<pid_t> children;
    for (int wait = 0; wait < 1000 && children.size() < 3; ++wait) {
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
      children = children_of(launcher);
    }
    ASSERT_GE(children.size(), 3u);
    std::this_thread::sleep_for(std::chrono::seconds(2));
    ::kill(children[victim], SIGKILL);
    int status = 0;
    ::waitpid(launcher, &status, 0);
    EXPECT_TRUE(!WIFEXITED(status) || WEXITSTATUS(status) != 0);
    EXPECT_THAT(outputs(), testing::IsEmpty());
  }
};

struct Input {
  const char* name;
  const char* arguments;  // with {points} and {cells} for their numbers
  enum class Files { none, points, mesh } files = Files::none;

  [[maybe_unused]] friend void PrintTo(const Input& input, std::ostream* out) { *out << input.name; }
};

class SameBytes : public RanksTest, public testing::WithParamInterface<Input> {};

TEST_P(SameBytes, AsOneProcess) {
  const Input& input = GetParam();
  if (input.files == Input::Files::points) write_npy_pieces();
  if (input.files == Input::Files::mesh) {
    expect_done(std::string("svgen mesh --pieces 6 -o mesh --cells ") + (is_long() ? "6e5" : "1e5"));
  }
  const std::string arguments =
      fmt::format(fmt::runtime(input.arguments), fmt::arg("points", is_long() ? "7e5" : "2e5"),
                  fmt::arg("cells", is_long() ? "3.6e6" : "6e5"));
  const Outcome alone = run("svbuild " + arguments + " -o out/alone.svol");
  ASSERT_EQ(alone.code, 0) << alone.err;
  for (const int count : sample_of<int>({3, 1, 2, 4, 8})) {
    const Outcome together = run(ranks(count, arguments + " --threads 1 -o out/together.svol"));
    ASSERT_EQ(together.code, 0) << together.err;
    EXPECT_EQ(run("cmp out/alone.svol out/together.svol").out, "") << count << " ranks";
    // The census is the same, too.
    const auto rest = [](const std::string& text) { return text.substr(std::min(text.find('\n'), text.size())); };
    if (count == 1) {
      EXPECT_EQ(rest(together.out), rest(alone.out));
    } else {
      EXPECT_THAT(together.out, HasSubstr(std::to_string(count) + " processes"));
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Inputs, SameBytes,
    testing::ValuesIn(sample_of<Input>(
        {Input{"boxes", "gen:points:count={points},distribution=vortex,type=float32 --connectivity boxes"},
         Input{"mesh", "gen:mesh:cells={cells},pieces=12 --drop-cells"},
         Input{"gradients", "p0.npy p1.npy p2.npy p3.npy p4.npy --connectivity boxes --gradients --exact --leaf 16",
               Input::Files::points},
         Input{"small_mesh", "gen:mesh:cells=1e5,pieces=8 --drop-cells"},
         Input{"kept_cells_of_a_small_mesh", "gen:mesh:cells=1e5,pieces=8"},
         Input{"kept_delaunay_cells", "gen:points:count=2e4,distribution=clusters"},
         Input{"files_of_cells", "mesh --cells own --drop-cells", Input::Files::mesh},
         Input{"two_clusters", "gen:points:count={points},distribution=two-clusters --connectivity boxes --memory 64M"},
         Input{"attributes", "p0.npy p1.npy p2.npy p3.npy p4.npy --connectivity boxes", Input::Files::points},
         Input{"half_tiny", "gen:points:count={points},distribution=half-tiny --connectivity boxes"},
         Input{"equal", "gen:points:count={points},distribution=equal --connectivity boxes"},
         Input{"one_piece", "gen:mesh:cells={cells},pieces=1 --drop-cells"},
         Input{"large_leaves", "gen:points:count={points},distribution=vortex --connectivity boxes --leaf 300"},
         Input{"mesh_of_large_leaves", "gen:mesh:cells={cells},pieces=12 --drop-cells --leaf 300 --memory 128M"},
         Input{"few_points", "gen:points:count=4,distribution=uniform --connectivity none"},
         Input{"joined_at_once", "gen:points:count=2e4,distribution=clusters --drop-cells"},
         Input{"other_reduction", "p0.npy p1.npy p2.npy p3.npy p4.npy --connectivity boxes --reduction kdtree",
               Input::Files::points},
         Input{"kept_cells", "gen:mesh:cells={cells},pieces=12"},
         Input{"kept_cells_of_files", "mesh", Input::Files::mesh}},
        7)),
    [](const auto& input) { return input.param.name; });

// A lattice of 20^3 points that begins at x, with these values.
void write_lattice(const std::string& path, int x, const std::vector<std::string>& arrays) {
  std::ofstream file(path);
  file << "# vtk DataFile Version 3.0\ntest\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 20 20 20\nORIGIN " << x
       << " 0 0\nSPACING 1 1 1\nPOINT_DATA 8000\n";
  for (const std::string& name : arrays) {
    file << "SCALARS " << name << " double 1\nLOOKUP_TABLE default\n";
    for (int i = 0; i < 8000; ++i) file << i % 20 + x << "\n";
  }
}

// Each rank reads a part of the files, and knows the arrays of all.
TEST_F(RanksTest, KnowTheArraysOfAllFiles) {
  write_lattice(path("a.vtk"), 0, {"p"});
  write_lattice(path("b.vtk"), 19, {"p", "q"});
  write_lattice(path("c.vtk"), 38, {"r", "p"});
  const std::string build = "a.vtk b.vtk c.vtk --strict";
  const Outcome alone = run("svbuild " + build + " -o out/alone.svol");
  ASSERT_EQ(alone.code, 0) << alone.err;
  EXPECT_THAT(alone.out, HasSubstr("q, r: missing where a part of the input lacks it"));
  EXPECT_THAT(alone.out, HasSubstr("16000 missing values: q"));
  for (const int count : {2, 3}) {
    const Outcome together = run(ranks(count, build + " -o out/together.svol"));
    ASSERT_EQ(together.code, 0) << together.err;
    EXPECT_EQ(run("cmp out/alone.svol out/together.svol").out, "") << count << " ranks";
    EXPECT_THAT(together.out, HasSubstr("16000 missing values: q"));
  }
}

TEST_F(RanksTest, ShareThePointsEvenly) {
  for (const std::string& distribution : sample_of<std::string>({"half-tiny", "vortex", "layer", "clusters"})) {
    const json work = build_of(4, "gen:points:count=7e5,distribution=" + distribution + " --connectivity boxes");
    EXPECT_EQ(work.at("ranges"), 4) << distribution;
    const auto owned = work.at("owned_bytes").get<std::vector<double>>();
    const double mean = work.at("record_bytes").get<double>() / 4;
    EXPECT_LE(std::ranges::max(owned), 1.3 * mean) << distribution;
  }
  EXPECT_EQ(build_of(4, "gen:points:count=7e5,distribution=equal --connectivity boxes").at("ranges"), 1);
}

// Beside --memory, a rank holds the program and MPI, which a small build shows, and 64 MiB.
TEST_F(RanksTest, HoldNoMoreThanTheirMemory) {
  const auto peak = [&](const std::string& arguments) {
    const auto peaks = build_of(3, arguments).at("peak_memory").get<std::vector<std::uint64_t>>();
    return std::ranges::max(peaks);
  };
  const std::uint64_t base = peak("gen:points:count=4 --connectivity none");
  const std::string points = is_long() ? "6e6" : "2e6";
  for (const std::uint64_t memory : is_long() ? std::vector{128, 256} : std::vector{64})
    EXPECT_LE(peak("gen:points:count=" + points + ",distribution=vortex --connectivity boxes --memory " +
                   std::to_string(memory) + "M"),
              base + (memory + 64) * mebibyte);
}

TEST_F(RanksTest, SendLittleMoreThanTheRecords) {
  const std::string points = is_long() ? "5e6" : "2e6";
  const json work =
      build_of(3, "gen:points:count=" + points + ",distribution=vortex,type=float32 --connectivity boxes");
  EXPECT_LE(work.at("sent_bytes").get<double>(), 1.2 * work.at("record_bytes").get<double>());
}

TEST_F(RanksTest, FailTogetherIfOneCannotReadItsPiece) {
  expect_done("svgen mesh --cells 1e5 --pieces 6 -o mesh");
  fs::resize_file(path("mesh/piece4.vtu"), fs::file_size(path("mesh/piece4.vtu")) / 2);
  expect_one_failure(ranks(3, "mesh -o out/a.svol"), "piece4.vtu");
  expect_one_failure(ranks(3, "mesh/none.vtu -o out/a.svol"), "none.vtu");
}

TEST_F(RanksTest, FailTogetherIfTheDiskOfOneIsFull) {
  const std::string build =
      SPLATVOL_BIN "/svbuild gen:points:count=6e6,distribution=vortex --connectivity boxes --memory 64M -o out/a.svol";
  // MPI has files of its own, which must fit.
  const std::string limited = "ulimit -f 30000; exec " + build;
  for (const int one : {2, 0}) expect_one_failure(ranks_but_one(3, one, limited, "exec " + build), "File too large");
}

TEST_F(RanksTest, RefuseWhatOneProcessDoes) {
  expect_one_failure(ranks(2, "gen:points:count=100 --series -o out/a.svol"), "work of one process");
  expect_one_failure(ranks(2, "gen:mesh:cells=1000 --boundary -o out/a.svol"),
                     "--boundary is work of one process: start svbuild without MPI");
}

TEST_F(RanksTest, TellThatCellsOfTheirOwnAreNotKept) {
  expect_done("svgen mesh --cells 1000 --pieces 2 -o mesh");
  const std::string build = "mesh --cells own";
  expect_done("svbuild " + build + " --drop-cells -o out/dropped.svol");
  const Outcome together = run(ranks(2, build + " -o out/together.svol"));
  ASSERT_EQ(together.code, 0) << together.err;
  EXPECT_THAT(together.out, HasSubstr("warning: the file does not keep cells of their own"));
  EXPECT_EQ(run("cmp out/dropped.svol out/together.svol").out, "");
}

TEST_F(RanksTest, SayOnceWhatIsWrongWithTheCommand) {
  const Outcome outcome = run(ranks(3, "gen:points:count=100 --nonsense -o out/a.svol"));
  EXPECT_EQ(outcome.code, 2);
  EXPECT_EQ(outcome.err.find("--nonsense"), outcome.err.rfind("--nonsense")) << outcome.err;
}

TEST_F(RanksTest, RefuseDifferentCommands) {
  const std::string build = "exec " SPLATVOL_BIN "/svbuild gen:points:count=9 -o out/";
  const Outcome outcome = run(ranks_but_one(2, 0, build + "a.svol", build + "b.svol"));
  EXPECT_EQ(outcome.code, 2);
  EXPECT_EQ(lines_of(outcome), 1);
  EXPECT_THAT(outcome.err, HasSubstr("different command lines"));
  EXPECT_THAT(outputs(), testing::IsEmpty());
}

TEST_F(RanksTest, EndIfOneIsKilled) {
  for (const std::size_t victim : sample_of<std::size_t>({1, 0})) expect_end_of_all(victim, "");
}

// As on file systems that force names, or on several machines.
TEST_F(RanksTest, EndIfOneIsKilledAndTheFileHasAName) {
  for (const std::size_t victim : sample_of<std::size_t>({0, 1})) expect_end_of_all(victim, SPLATVOL_NO_TMPFILE);
}

TEST_F(RanksTest, MakeTheSameBytesIfTheFileHasAName) {
  const std::string input = " gen:points:count=6e5,distribution=vortex --connectivity boxes";
  expect_done("svbuild" + input + " -o out/alone.svol");
  const Outcome together =
      run(SPLATVOL_MPIEXEC " -n 3 env LD_PRELOAD=" SPLATVOL_NO_TMPFILE " " SPLATVOL_BIN "/svbuild" + input +
          " -o out/together.svol");
  EXPECT_EQ(together.code, 0) << together.err;
  EXPECT_EQ(run("cmp out/alone.svol out/together.svol").out, "");
  EXPECT_THAT(outputs(), testing::UnorderedElementsAre("alone.svol", "together.svol"));
}

// The first rank waits for the disk twice: for the file, and for its name.
TEST_F(RanksTest, TellWhatADiskThatFailsOnceHas) {
  const auto build = [&](int call, int error) {
    return run("rm -f out/*; " SPLATVOL_MPIEXEC " -n 2 env LD_PRELOAD=" SPLATVOL_FAILING_DISK
               " SPLATVOL_FAIL_ONLY=fsync SPLATVOL_FAIL_CALL=" +
               std::to_string(call) + " SPLATVOL_FAIL_ERROR=" + std::to_string(error) +
               " " SPLATVOL_BIN "/svbuild gen:points:count=1000 -o out/a.svol");
  };
  const Outcome lost = build(0, EIO);
  EXPECT_EQ(lost.code, 1);
  EXPECT_EQ(lines_of(lost), 1) << lost.err;
  EXPECT_THAT(outputs(), testing::IsEmpty());

  const Outcome unconfirmed = build(1, EIO);
  EXPECT_EQ(unconfirmed.code, 1);
  EXPECT_THAT(unconfirmed.err, HasSubstr("the disk has not confirmed the name"));
  EXPECT_EQ(run("svinfo --verify out/a.svol").code, 0);

  for (const int call : {0, 1}) {
    EXPECT_EQ(build(call, EINTR).code, 0);
    EXPECT_THAT(outputs(), testing::ElementsAre("a.svol"));
  }
}

}  // namespace
}  // namespace splatvol::test
