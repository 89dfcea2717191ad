// The entries of OpenFOAM's dictionaries, for the macros that name them.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "builder/sources/openfoam/foam_reader.h"

namespace splatvol {

class FoamDictionary;

/// The value of a key: words, or a dictionary.
struct FoamEntry {
  std::vector<FoamToken> words = {};
  bool is_whole = true;  // if not, there are more words than are kept
  std::shared_ptr<const FoamDictionary> dictionary = nullptr;
};

/// Entries by their keys.
class FoamDictionary {
 public:
  void set(const std::string& key, FoamEntry entry) { entries_.insert_or_assign(key, std::move(entry)); }

  /// Adds the entries of another dictionary, in place of those of the same keys.
  void merge(const FoamDictionary& other) {
    for (const auto& [key, entry] : other.entries_) set(key, entry);
  }

  /// Null: there is none.
  [[nodiscard]] const FoamEntry* find(const std::string& key) const;

 private:
  std::map<std::string, FoamEntry> entries_;
};

/// Reads the entries of a file, and puts in what macros stand for: `$name`, `${name}`, `$name.inner`, `$:name.inner`,
/// `$!name/inner`. A macro that stands for nothing so far stays as it is. Throws if there are other directives than
/// `#include`, `#includeEtc` and `#inputMode merge`: they may change what an entry is.
class FoamEntries {
 public:
  /// Takes the entry of a key, or returns false. Called for the keys outside of all inner dictionaries.
  using Take = std::function<bool(const std::string& key)>;

  FoamEntries(FoamReader& reader, Take take) : reader_(reader), take_(std::move(take)) {}

  /// Passes over other directives from now on: what follows does not matter.
  void ignore_directives() { ignores_directives_ = true; }

  /// Reads one entry. Returns false at the end of the file.
  bool read_next();

  /// Reads the words up to the next `;`, which is taken too. Throws if they are more than 256, or if one is a macro
  /// without a value or a directive.
  [[nodiscard]] std::vector<FoamToken> read_plain_words();

  /// Finds the entry that a macro names. Null: there is none.
  [[nodiscard]] const FoamEntry* find(std::string_view macro) const;

 private:
  bool read_entry();
  void read_dictionary(const std::string& key);
  void obey(const FoamToken& directive);
  FoamEntry read_words();

  FoamReader& reader_;
  Take take_;
  bool ignores_directives_ = false;
  std::vector<FoamDictionary> open_ = {{}};  // the file's, and the inner ones that are being read
};

}  // namespace splatvol
