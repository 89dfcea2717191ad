#include "builder/sources/process/reader_process.h"

#include <gmock/gmock.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "builder/opening/open_source.h"
#include "builder/sources/process/serve_sources.h"
#include "tests/builder/sources/read_input.h"
#include "tests/support/sanitizers.h"
#include "tests/support/temp_folder.h"

namespace splatvol {
namespace {

using test::reader_options;
using testing::AllOf;
using testing::HasSubstr;
using testing::StartsWith;

class ReaderProcessTest : public test::FolderTest {
 protected:
  /// A tetrahedron with an attribute of numbers, and more arrays at its points.
  std::string mesh(const std::string& name, const std::string& more = "") const {
    return write(name,
                 "<VTKFile type=\"UnstructuredGrid\" version=\"0.1\"><UnstructuredGrid><Piece NumberOfPoints=\"4\" "
                 "NumberOfCells=\"1\"><PointData>" +
                     more +
                     "<DataArray type=\"Float32\" Name=\"f\" format=\"ascii\">1 2 3 4</DataArray></PointData>"
                     "<Points><DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"ascii\">0 0 0 1 0 0 0 1 0 "
                     "0 0 1</DataArray></Points><Cells><DataArray type=\"Int32\" Name=\"connectivity\" "
                     "format=\"ascii\">0 1 2 3</DataArray><DataArray type=\"Int32\" Name=\"offsets\" "
                     "format=\"ascii\">4</DataArray><DataArray type=\"UInt8\" Name=\"types\" "
                     "format=\"ascii\">10</DataArray></Cells></Piece></UnstructuredGrid></VTKFile>");
  }
  std::string sound_mesh() const { return mesh("sound.vtu"); }

  static std::string error_of(const ReaderProcessOptions& options, const std::string& input) {
    ReaderProcess reader(options);
    const auto source = reader.open({input}, {});
    return source ? "(no error)" : source.error().message;
  }

  std::string sleeping_program() const {
    const std::string program = write("reader.sh", "#!/bin/bash\nexec sleep 60");
    std::filesystem::permissions(program, std::filesystem::perms::owner_all);
    return program;
  }

  static ReaderProcessOptions options_with(const std::string& program) {
    ReaderProcessOptions options = reader_options();
    options.program = program;
    options.patience = std::chrono::seconds(2);
    return options;
  }
};

TEST_F(ReaderProcessTest, ACrashIsOneLineAndTheNextFileIsRead) {
  // VTK 9.1 follows a null pointer for texts without their ends.
  const std::string hostile =
      mesh("hostile.vtu", "<DataArray type=\"String\" Name=\"s\" format=\"ascii\">1 2 3 4</DataArray>");
  ReaderProcess reader(reader_options());
  const auto refused = reader.open({hostile}, {});
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, AllOf(StartsWith(hostile), HasSubstr(test::is_sanitized ? "ended" : "crashes")));
  const auto source = reader.open({sound_mesh()}, {});
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_EQ((*source)->next().value()->points.size(), 4u);
}

TEST_F(ReaderProcessTest, MemoryIsLimited) {
  if (test::is_sanitized) GTEST_SKIP() << "sanitizers reserve more memory than any limit";
  ReaderProcessOptions options = reader_options();
  options.memory = 1u << 20;
  EXPECT_THAT(error_of(options, sound_mesh()), HasSubstr("memory"));
}

TEST_F(ReaderProcessTest, AReaderThatDoesNotGetOnIsEnded) {
  EXPECT_THAT(error_of(options_with("/bin/sleep"), sound_mesh()), HasSubstr("for 2 s"));
  EXPECT_THAT(error_of(options_with("/bin/false"), sound_mesh()), HasSubstr("ended too early"));
  EXPECT_THAT(error_of(options_with(path("none")), sound_mesh()),
              AllOf(HasSubstr("cannot start"), HasSubstr(path("none"))));
}

// Programs in place of the reader, with a small share of what it may read and how long it may take.
TEST_F(ReaderProcessTest, AReaderThatReadsOrTakesTooMuchIsEnded) {
  const auto error_of_script = [&](const std::string& script, double factor, int patience) {
    const std::string program = write("reader.sh", "#!/bin/bash\n" + script);
    std::filesystem::permissions(program, std::filesystem::perms::owner_all);
    ReaderProcessOptions options = options_with(program);
    options.factor = factor;
    options.patience = std::chrono::seconds(patience);
    return error_of(options, sound_mesh());
  };
  EXPECT_THAT(error_of_script("exec cat /dev/zero > /dev/null", 1e-3, 60),
              AllOf(StartsWith(path("sound.vtu") + ": more than 1.07 MB were read for it"),
                    HasSubstr("'--read-factor 0.004'")));
  EXPECT_THAT(error_of_script("exec sleep 60", 1e-3, 60),
              AllOf(StartsWith(path("sound.vtu") + ": reading it takes longer than 0.6 s"),
                    HasSubstr("'--read-factor 0.004'")));
  // A refusal of 4096 characters, of which one comes now and then.
  EXPECT_THAT(error_of_script("printf '\\1\\0\\0\\0\\0\\0\\x10\\0\\0\\0\\0\\0\\0' >&3\n"
                              "while printf x >&3; do sleep 0.1; done",
                              5e-3, 2),
              HasSubstr("longer than 3 s"));
}

// A large input may be read for longer.
TEST_F(ReaderProcessTest, WhatIsAllowedGrowsWithTheInput) {
  std::ofstream(path("large.vtu")).close();
  std::filesystem::resize_file(path("large.vtu"), 1'000'000'000);
  ReaderProcessOptions options = options_with(sleeping_program());
  options.patience = std::chrono::seconds(60);
  options.factor = 1e-3;
  EXPECT_THAT(error_of(options, path("large.vtu")), HasSubstr("longer than 1.6 s"));
}

// More than the kernel holds for a socket.
TEST_F(ReaderProcessTest, AReaderThatDoesNotTakeWhatIsSentIsEnded) {
  ReaderProcess reader(options_with(sleeping_program()));
  const auto source = reader.open(std::vector<std::string>(1000, std::string(10'000, 'x')), {});
  ASSERT_FALSE(source);
  EXPECT_THAT(source.error().message, HasSubstr("for 2 s"));
}

TEST_F(ReaderProcessTest, NoProcessIsLeft) {
  {
    ReaderProcess reader(reader_options());
    EXPECT_TRUE(reader.open({sound_mesh()}, {}));
  }
  (void)error_of(options_with("/bin/sleep"), sound_mesh());
  EXPECT_EQ(::waitpid(-1, nullptr, WNOHANG), -1);
  EXPECT_EQ(errno, ECHILD);
}

TEST_F(ReaderProcessTest, SourcesOutliveTheReaderAndItsOtherSources) {
  std::unique_ptr<Source> second;
  {
    ReaderProcess reader(reader_options());
    const auto first = reader.open({sound_mesh()}, {}).value();
    second = reader.open({sound_mesh()}, {}).value();
  }
  EXPECT_EQ(second->next().value()->points.size(), 4u);
  EXPECT_EQ(second->next().value(), nullptr);
}

TEST_F(ReaderProcessTest, SurfacesAndSourcesShareAProcess) {
  const std::string surface = write("a.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n");
  ReaderProcess reader(reader_options());
  const auto source = reader.open({sound_mesh()}, {});
  ASSERT_TRUE(source) << source.error().message;
  const auto mesh = reader.read_surface(surface);
  ASSERT_TRUE(mesh) << mesh.error().message;
  EXPECT_EQ(mesh->points.size(), 4u);
  EXPECT_EQ(mesh->triangles.size(), 2u);
  EXPECT_THAT(reader.read_surface(path("none.obj")).error().message, StartsWith(path("none.obj")));
  EXPECT_EQ((*source)->next().value()->points.size(), 4u);
}

}  // namespace
}  // namespace splatvol
