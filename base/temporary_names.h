// The names of temporary files, for programs that a signal ends.
#pragma once

#include <string>

namespace splatvol {

/// Notes a temporary file, or a folder of files, until forget_temporary(). Thread-safe. At most 64 names are noted at a
/// time; no program has so many outputs.
void note_temporary(const std::string& path);
void forget_temporary(const std::string& path);

/// Removes the files and folders that are noted. Safe in a signal handler.
void remove_temporaries();

}  // namespace splatvol
