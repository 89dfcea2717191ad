// Checks that an HDF5 file holds what it declares: the library reads zeros for values that are nowhere.
#pragma once

#include <vtk_hdf5.h>

#include <string>

namespace splatvol {

/// Closes an object of the library.
class Hdf5Handle {
 public:
  Hdf5Handle(hid_t id, herr_t (*close)(hid_t)) : id_(id), close_(close) {}
  ~Hdf5Handle() {
    if (id_ >= 0) close_(id_);
  }
  Hdf5Handle(const Hdf5Handle&) = delete;
  Hdf5Handle& operator=(const Hdf5Handle&) = delete;
  [[nodiscard]] hid_t id() const { return id_; }
  [[nodiscard]] bool is_open() const { return id_ >= 0; }

 private:
  hid_t id_;
  herr_t (*close_)(hid_t);
};

/// Keeps the library from loading filters, which are programs, from the folder that HDF5_PLUGIN_PATH names. To be
/// called before a file is read.
void forbid_hdf5_plugins();

/// Whether an array holds numbers. False for texts. Throws a ReaderError if `object` is not open, because its link
/// leads nowhere, if it is no array, and if it holds something else. `name`: for messages.
[[nodiscard]] bool holds_numbers(const Hdf5Handle& object, const std::string& name);

/// Throws a ReaderError unless the file has every value of an array: files of raw data must be long enough. A part that
/// was never written passes if its fill value stands for a missing value. Virtual arrays are refused. `name`: for
/// messages.
void check_values(hid_t array, const std::string& name);

/// Which arrays of a file must have been written.
enum class Hdf5Arrays {
  all,
  any  // the library of the format finds those that it needs
};

/// Throws a ReaderError unless check_values() passes every array of numbers of a file, and every link leads somewhere.
/// Does not look into other files that it links.
void check_hdf5_file(const std::string& path, Hdf5Arrays written);

}  // namespace splatvol
