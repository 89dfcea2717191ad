#include "builder/sources/process/input_bytes.h"

#include <filesystem>
#include <string>

#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

struct InputBytesTest : FolderTest {
  /// A file of so many bytes.
  std::string data(const std::string& name, std::size_t bytes) const { return write(name, std::string(bytes, 'x')); }
};

TEST_F(InputBytesTest, FilesCountOnce) {
  const std::string a = data("a.vtu", 1000), b = data("b.vtu", 200);
  EXPECT_EQ(input_bytes({a}), 1000u);
  EXPECT_EQ(input_bytes({a, b, a, path("./a.vtu")}), 1200u);
  EXPECT_EQ(input_bytes({path("none.vtu"), "/dev/zero"}), 0u);
  std::filesystem::create_symlink("a.vtu", path("link.vtu"));
  EXPECT_EQ(input_bytes({path("link.vtu")}), 1000u);
}

TEST_F(InputBytesTest, AFolderIsAllThatIsInIt) {
  (void)data("a.vtu", 1000);
  (void)data("sub/deep/p", 300);
  EXPECT_EQ(input_bytes({folder_}), 1300u);
  EXPECT_EQ(input_bytes({data("case.foam", 0)}), 1300u);
  EXPECT_EQ(input_bytes({data("system/controlDict", 10)}), 1310u);
}

TEST_F(InputBytesTest, AListCountsWithWhatItNames) {
  (void)data("sub/a.vtu", 1000);
  (void)data("sub/b.vtu", 2000);
  (void)data("sub/other.vtu", 100'000);
  const std::string blocks = "<DataSet file='a.vtu'/><DataSet file=\"b.vtu\"/><DataSet file=\"a.vtu\"/>";
  const std::string loop = "<DataSet file=\"all.vtm\"/>";
  write("sub/all.vtm", blocks + loop);
  EXPECT_EQ(input_bytes({path("sub/all.vtm")}), 3000 + blocks.size() + loop.size());
  const std::string series = "<DataSet timestep=\"1\" file=\"sub/all.vtm\"/>";
  write("series.PVD", series);
  EXPECT_EQ(input_bytes({path("series.PVD")}), 3000 + blocks.size() + loop.size() + series.size());
  const std::string scene = R"({"buffers":[{"uri":"sub/a.vtu"},{"uri":"data:;base64,AAAA"}]})";
  EXPECT_EQ(input_bytes({write("a.gltf", scene)}), 1000 + scene.size());
}

TEST_F(InputBytesTest, PatternsOfNamesAreFilledIn) {
  for (const char* name : {"v.0001", "v.0002", "v.0003"}) (void)data(std::string("sub/") + name, 100);
  (void)data("m.geo", 50);
  const std::string text = "GEOMETRY\nmodel: m.geo\nVARIABLE\nscalar per node: p sub/v.****\n";
  EXPECT_EQ(input_bytes({write("a.case", text)}), 350 + text.size());
  for (const char* name : {"mesh.e.3.0", "mesh.e.3.1", "mesh.e.3.2", "mesh.e.4.0"}) (void)data(name, 10);
  EXPECT_EQ(input_bytes({path("mesh.e.3.1")}), 30u);
}

}  // namespace
}  // namespace splatvol::test
