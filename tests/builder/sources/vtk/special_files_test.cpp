// Files that name pipes, devices and sockets: these are refused by name, before anything waits for them.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <string>
#include <vector>

#include "tests/builder/sources/hdf5/hdf5_arrays.h"
#include "tests/builder/sources/read_input.h"
#include "tests/builder/sources/vtk_text.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

enum class Special { pipe, device, socket };
constexpr std::array specials = {Special::pipe, Special::device, Special::socket};

struct SpecialFilesTest : FolderTest {
  void make(Special special, const std::string& name) const {
    std::filesystem::create_directories(std::filesystem::path(path(name)).parent_path());
    std::filesystem::remove(path(name));
    if (special == Special::pipe) {
      ASSERT_EQ(::mkfifo(path(name).c_str(), 0600), 0);
    }
    if (special == Special::device) std::filesystem::create_symlink("/dev/zero", path(name));
    if (special != Special::socket) return;
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    path(name).copy(address.sun_path, sizeof(address.sun_path) - 1);
    const int socket = ::socket(AF_UNIX, SOCK_STREAM, 0);
    ASSERT_EQ(::bind(socket, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
    ::close(socket);
  }

  /// Expects that an input is refused because of a file that it names, whatever stands there.
  void expect_refused(const std::vector<std::string>& inputs, const std::string& named) const {
    std::vector<std::string> paths;
    for (const std::string& input : inputs) paths.push_back(path(input));
    for (const Special special : specials) {
      make(special, named);
      EXPECT_THAT(error_of(paths), AllOf(HasSubstr(named), AnyOf(HasSubstr("a pipe, a device or a socket"),
                                                                 HasSubstr("not a regular file"),
                                                                 HasSubstr("No such device or address"))))
          << inputs[0] << " " << static_cast<int>(special);
    }
  }
};

TEST_F(SpecialFilesTest, OfEnsight) {
  const std::string geometry =
      "a\nb\nnode id off\nelement id off\npart\n1\nd\ncoordinates\n4\n0\n1\n0\n0\n0\n0\n1\n0\n0\n0\n0\n1\n"
      "tetra4\n1\n1 2 3 4\n";
  write("geo", geometry);
  write("f", "f\npart\n1\ncoordinates\n1\n2\n3\n4\n");
  for (const char* type : {"ensight gold", "ensight"}) {
    write("a.case", fmt::format("FORMAT\ntype: {}\nGEOMETRY\nmodel: geo\nVARIABLE\nscalar per node: f f\n", type));
    expect_refused({"a.case"}, "geo");
    write("geo", geometry);
    expect_refused({"a.case"}, "f");
    write("f", "f\npart\n1\ncoordinates\n1\n2\n3\n4\n");
  }
}

TEST_F(SpecialFilesTest, OfFilesOfVtk) {
  write("a.pvtu", vtk_file("PUnstructuredGrid", "<Piece Source=\"piece\"/>", "GhostLevel=\"0\""));
  write("a.vtm", vtm_file({"piece"}));
  write("a.pvd", vtk_file("Collection", "<DataSet timestep=\"0\" file=\"piece\"/>"));
  for (const char* name : {"a.pvtu", "a.vtm", "a.pvd"}) expect_refused({name}, "piece");
  write("a.su2", "NDIME= 3\nNELEM= 1\n10 0 1 2 3\nNPOIN= 4\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n");
  expect_refused({"a.su2", "values.csv"}, "values.csv");
}

TEST_F(SpecialFilesTest, OfOpenFoam) {
  const std::string head = "FoamFile { version 2.0; format ascii; class dictionary; object controlDict; }\n";
  write("0/p", "");
  for (const char* name : {"points", "faces", "owner", "neighbour", "boundary"})
    write(fmt::format("constant/polyMesh/{}", name), "");
  write("system/controlDict", head + "application icoFoam;\nstartTime 0;\ndeltaT 1;\n");
  expect_refused({"system/controlDict"}, "constant/polyMesh/boundary");
  write("constant/polyMesh/boundary", "#include \"$FOAM_CASE/included\"\n");
  expect_refused({"system/controlDict"}, "included");
}

TEST_F(SpecialFilesTest, OfHdf5) {
  const hid_t file = H5Fcreate(path("a.vtkhdf").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  H5Lcreate_external("other", "/VTKHDF", file, "VTKHDF", H5P_DEFAULT, H5P_DEFAULT);
  H5Fclose(file);
  std::filesystem::copy(path("a.vtkhdf"), path("a.cgns"));
  std::filesystem::copy(path("a.vtkhdf"), path("a.e"));
  for (const char* name : {"a.vtkhdf", "a.cgns", "a.e"}) expect_refused({name}, "other");
}

TEST_F(SpecialFilesTest, OfGltf) {
  ReaderProcess reader(reader_options());
  write("a.gltf",
        R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],"meshes":[{"primitives":)"
        R"([{"attributes":{"POSITION":0},"mode":4}]}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,)"
        R"("type":"VEC3","min":[0,0,0],"max":[2,2,0]}],"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":36}],)"
        R"("buffers":[{"byteLength":36,"uri":"buffer.bin"}]})");
  EXPECT_THAT(reader.read_surface(path("a.gltf")).error().message, HasSubstr("buffer.bin: cannot open"));
  for (const Special special : specials) {
    make(special, "buffer.bin");
    EXPECT_THAT(message_of(reader.read_surface(path("a.gltf"))),
                AllOf(StartsWith(path("a.gltf")), HasSubstr("buffer.bin: "),
                      AnyOf(HasSubstr("not a regular file"), HasSubstr("No such device or address"))));
  }
}

}  // namespace
}  // namespace splatvol::test
