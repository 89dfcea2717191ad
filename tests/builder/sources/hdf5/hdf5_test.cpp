// HDF5 files whose values are elsewhere, or nowhere: the library reads zeros, or drops the array.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <sys/stat.h>

#include <cmath>
#include <cstdlib>
#include <functional>
#include <string>
#include <vector>

#include "base/file.h"
#include "tests/builder/sources/hdf5/hdf5_arrays.h"
#include "tests/builder/sources/read_input.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

const std::vector<double> values = {1, 2, 3, 4};

struct Hdf5Test : FolderTest {
  /// Writes a tetrahedron with the values "f" and what `put_more` puts at its points.
  std::string write_mesh(const std::string& name, const std::function<void(hid_t points)>& put_more) const {
    const hid_t file = H5Fcreate(path(name).c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT),
                root = make_group(file, "VTKHDF"), points = make_group(root, "PointData");
    put_tetrahedron(root);
    put_array<double>(points, "f", values);
    put_more(points);
    for (const hid_t group : {points, root}) H5Gclose(group);
    H5Fclose(file);
    return path(name);
  }

  /// Writes a file of another type, without data.
  std::string write_type(const std::string& name, const std::string& type) const {
    const hid_t file = H5Fcreate(path(name).c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT),
                root = make_group(file, "VTKHDF");
    put_type(root, type);
    H5Gclose(root);
    H5Fclose(file);
    return path(name);
  }

  /// Expects that an array "p" at the points is refused by its name, unless it is not wanted.
  void expect_refused(const std::string& reason, const std::function<void(hid_t points)>& put_p) const {
    const std::string mesh = write_mesh("a.vtkhdf", put_p);
    EXPECT_THAT(error_of({mesh}), AllOf(StartsWith(mesh), HasSubstr("PointData/p\""), HasSubstr(reason)));
    EXPECT_EQ(error_of({mesh}, {{"f"}, {}}), "(no error)") << reason;
  }

  /// Expects the values 1 to 4 of an array "p".
  void expect_values(const std::string& mesh) const {
    const auto input = value_of(read_input({mesh}, {{"p"}, {}}));
    EXPECT_EQ(input.pieces.at(0).values.at(0), values);
  }

  /// Two files of raw data with two numbers each, the second behind 8 other bytes.
  [[nodiscard]] hid_t raw_plan() const {
    const hid_t plan = H5Pcreate(H5P_DATASET_CREATE);
    H5Pset_external(plan, path("raw1").c_str(), 0, 16);
    H5Pset_external(plan, path("raw2").c_str(), 8, 16);
    return plan;
  }
};

TEST_F(Hdf5Test, OtherTypesOfVtkhdfAreRefusedWithTheWayOut) {
  for (const char* type : {"MultiBlockDataSet", "PartitionedDataSetCollection", "OverlappingAMR", "PolyData"})
    EXPECT_THAT(error_of({write_type("a.vtkhdf", type)}),
                AllOf(HasSubstr(fmt::format("of type \"{}\"", type)), HasSubstr("save the data as .vtm")));
}

TEST_F(Hdf5Test, RawDataThatIsCutOff) {
  const auto put_p = [&](hid_t points) { put_array<double>(points, "p", values, {}, raw_plan()); };
  const std::string mesh = write_mesh("a.vtkhdf", put_p);
  expect_values(mesh);
  for (const char* raw : {"raw1", "raw2"}) {
    const std::string whole = read_text_file(path(raw)).value();
    for (std::size_t bytes = 0; bytes < whole.size(); ++bytes) {
      write(raw, whole.substr(0, bytes));
      EXPECT_THAT(error_of({mesh}), AllOf(HasSubstr("PointData/p"), HasSubstr(path(raw)))) << bytes;
    }
    std::filesystem::remove(path(raw));
    EXPECT_THAT(error_of({mesh}), AllOf(HasSubstr("PointData/p"), HasSubstr(path(raw))));
    ::mkfifo(path(raw).c_str(), 0600);
    EXPECT_THAT(error_of({mesh}), HasSubstr(path(raw) + ": not a regular file"));
    write(raw, whole);
  }
  expect_values(mesh);
}

TEST_F(Hdf5Test, ArraysThatWereNotWritten) {
  const auto chunked = [](const double* fill) {
    const hid_t plan = H5Pcreate(H5P_DATASET_CREATE);
    const hsize_t side = 2;
    H5Pset_chunk(plan, 1, &side);
    if (fill) H5Pset_fill_value(plan, H5T_NATIVE_DOUBLE, fill);
    return plan;
  };
  const auto put_half = [](hid_t points, hid_t plan) {
    put_array<double>(points, "p", {}, {4}, plan);
    const hid_t array = H5Dopen2(points, "p", H5P_DEFAULT), file = H5Dget_space(array);
    const hsize_t first = 0, count = 2;
    H5Sselect_hyperslab(file, H5S_SELECT_SET, &first, nullptr, &count, nullptr);
    const hid_t memory = H5Screate_simple(1, &count, nullptr);
    H5Dwrite(array, H5T_NATIVE_DOUBLE, memory, file, H5P_DEFAULT, values.data());
    for (const hid_t space : {memory, file}) H5Sclose(space);
    H5Dclose(array);
  };
  const auto compressed = [&] {
    const hid_t plan = chunked(nullptr);
    H5Pset_deflate(plan, 1);
    return plan;
  };
  const double nothing = std::nan(""), zero = 0;
  expect_refused("never written", [](hid_t points) { put_array<double>(points, "p", {}, {4}); });
  expect_refused("never written", [&](hid_t points) { put_array<double>(points, "p", {}, {4}, chunked(nullptr)); });
  expect_refused("written in parts only", [&](hid_t points) { put_half(points, chunked(nullptr)); });
  expect_refused("written in parts only", [&](hid_t points) { put_half(points, chunked(&zero)); });
  expect_refused("written in parts only", [&](hid_t points) { put_half(points, compressed()); });
  expect_values(
      write_mesh("packed.vtkhdf", [&](hid_t points) { put_array<double>(points, "p", values, {}, compressed()); }));
  expect_values(
      write_mesh("whole.vtkhdf", [&](hid_t points) { put_array<double>(points, "p", values, {}, chunked(nullptr)); }));
  const auto input = value_of(
      read_input({write_mesh("nan.vtkhdf", [&](hid_t points) { put_half(points, chunked(&nothing)); })}, {{"p"}, {}}));
  const std::vector<double>& half = input.pieces.at(0).values.at(0);
  EXPECT_EQ(half[1], 2);
  EXPECT_TRUE(std::isnan(half[2]));
}

TEST_F(Hdf5Test, LinksThatLeadNowhere) {
  const std::string other = write_mesh("other.vtkhdf", [](hid_t points) { put_array<double>(points, "p", values); });
  const auto link_to = [](const std::string& file, const char* object) {
    return [=](hid_t points) { H5Lcreate_external(file.c_str(), object, points, "p", H5P_DEFAULT, H5P_DEFAULT); };
  };
  const auto link_within = [](const char* object) {
    return [=](hid_t points) { H5Lcreate_soft(object, points, "p", H5P_DEFAULT, H5P_DEFAULT); };
  };
  expect_values(write_mesh("a.vtkhdf", link_to("other.vtkhdf", "/VTKHDF/PointData/p")));
  expect_values(write_mesh("a.vtkhdf", link_within("/VTKHDF/PointData/f")));
  const std::string reason = "a link that leads nowhere";
  expect_refused(reason, link_within("/VTKHDF/PointData/none"));
  expect_refused(reason, link_within("/VTKHDF/PointData/p"));
  expect_refused(reason, link_to("other.vtkhdf", "/VTKHDF/PointData/none"));
  expect_refused(reason, link_to("none.vtkhdf", "/VTKHDF/PointData/p"));
  write("other.vtkhdf", read_text_file(other)->substr(0, 2000));
  expect_refused(reason, link_to("other.vtkhdf", "/VTKHDF/PointData/p"));
}

TEST_F(Hdf5Test, ArraysOfOtherKinds) {
  expect_refused("a virtual one", [](hid_t points) {
    const hid_t plan = H5Pcreate(H5P_DATASET_CREATE);
    const hsize_t count = 4;
    const hid_t space = H5Screate_simple(1, &count, nullptr);
    H5Pset_virtual(plan, space, "none.vtkhdf", "/VTKHDF/PointData/p", space);
    put_array<double>(points, "p", {}, {4}, plan);
  });
  const auto put_type_of = [](hid_t type) {
    return [=](hid_t points) {
      const hsize_t count = 4;
      const hid_t space = H5Screate_simple(1, &count, nullptr);
      H5Dclose(H5Dcreate2(points, "p", type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
      H5Sclose(space);
    };
  };
  const hid_t pair = H5Tcreate(H5T_COMPOUND, 16);
  H5Tinsert(pair, "r", 0, H5T_NATIVE_DOUBLE);
  H5Tinsert(pair, "i", 8, H5T_NATIVE_DOUBLE);
  expect_refused("neither numbers nor texts", put_type_of(pair));
  const hsize_t three = 3;
  expect_refused("neither numbers nor texts", put_type_of(H5Tarray_create2(H5T_NATIVE_DOUBLE, 1, &three)));
  EXPECT_EQ(error_of({write_mesh("text.vtkhdf", put_type_of(H5Tcopy(H5T_C_S1)))}), "(no error)");
}

/// A library that HDF5 takes for a filter ends the process that loads it.
TEST_F(Hdf5Test, FiltersOfTheEnvironmentAreNotLoaded) {
  constexpr H5Z_filter_t number = 32042;
  const H5Z_class2_t filter = {
      H5Z_CLASS_T_VERS,
      number,
      1,
      1,
      "none",
      nullptr,
      nullptr,
      [](unsigned, std::size_t, const unsigned*, std::size_t bytes, std::size_t*, void**) { return bytes; }};
  H5Zregister(&filter);
  const std::string mesh = write_mesh("a.vtkhdf", [](hid_t points) {
    const hid_t plan = H5Pcreate(H5P_DATASET_CREATE);
    const hsize_t side = 4;
    H5Pset_chunk(plan, 1, &side);
    H5Pset_filter(plan, number, H5Z_FLAG_MANDATORY, 0, nullptr);
    put_array<double>(points, "p", values, {}, plan);
  });
  ASSERT_EQ(::setenv("HDF5_PLUGIN_PATH", SPLATVOL_HDF5_FILTERS, 1), 0);
  ReaderProcess reader(reader_options());
  const auto source = reader.open({mesh}, {});
  ::unsetenv("HDF5_PLUGIN_PATH");
  ASSERT_FALSE(source);
  EXPECT_THAT(source.error().message, HasSubstr("PointData/p\" is missing, damaged"));
}

}  // namespace
}  // namespace splatvol::test
