#include "builder/sources/openfoam/foam_dictionary.h"

#include <algorithm>
#include <utility>

namespace splatvol {
namespace {

using Kind = FoamToken::Kind;

constexpr std::size_t most_words = 256, deepest = 64;
constexpr const char* way_out = "write the values out by foamDictionary -expand";

/// The entry of a path such as "inner.value" in a dictionary. A key may hold the separator.
const FoamEntry* find_path(const FoamDictionary& dictionary, std::string_view path, std::string_view separators) {
  if (const FoamEntry* entry = dictionary.find(std::string(path))) return entry;
  const std::size_t cut = path.find_first_of(separators);
  if (cut == std::string_view::npos) return nullptr;
  const FoamEntry* outer = dictionary.find(std::string(path.substr(0, cut)));
  return outer && outer->dictionary ? find_path(*outer->dictionary, path.substr(cut + 1), separators) : nullptr;
}

}  // namespace

const FoamEntry* FoamDictionary::find(const std::string& key) const {
  const auto found = entries_.find(key);
  return found == entries_.end() ? nullptr : &found->second;
}

const FoamEntry* FoamEntries::find(std::string_view macro) const {
  if (macro.starts_with(':')) return find_path(open_.front(), macro.substr(1), "./");
  if (macro.starts_with('!')) return find_path(open_.front(), macro.substr(1), "/");
  for (std::size_t i = open_.size(); i-- > 0;)
    if (const FoamEntry* entry = find_path(open_[i], macro, "./")) return entry;
  return nullptr;
}

bool FoamEntries::read_next() {
  if (reader_.peek().kind != Kind::end) return read_entry();
  return false;
}

bool FoamEntries::read_entry() {
  const FoamToken key = reader_.next();
  if (key.is(';')) return true;
  if (key.kind == Kind::mark) reader_.fail("a key must stand there, and not \"{}\"", key.text);
  if (key.kind == Kind::directive) {
    obey(key);
  } else if (key.kind == Kind::macro) {
    const FoamEntry* entry = find(key.text);
    if (entry && entry->dictionary) open_.back().merge(FoamDictionary(*entry->dictionary));
    if (reader_.peek().is(';')) reader_.next();
  } else if (open_.size() == 1 && take_(key.text)) {
    return true;
  } else if (reader_.peek().is('{')) {
    read_dictionary(key.text);
  } else {
    open_.back().set(key.text, read_words());
  }
  return true;
}

void FoamEntries::read_dictionary(const std::string& key) {
  if (open_.size() > deepest) reader_.fail("dictionaries lie more than {} deep in each other", deepest);
  reader_.next();
  open_.emplace_back();
  while (!reader_.peek().is('}')) {
    if (reader_.peek().kind == Kind::end) reader_.expect('}');  // throws
    read_entry();
  }
  reader_.next();
  FoamEntry entry{{}, true, std::make_shared<FoamDictionary>(std::move(open_.back()))};
  open_.pop_back();
  open_.back().set(key, std::move(entry));
}

void FoamEntries::obey(const FoamToken& directive) {
  const bool outside = directive.text == "includeEtc" || directive.text == "includeFunc";
  const FoamToken value = reader_.next();
  if (!outside && !ignores_directives_ && (directive.text != "inputMode" || value.text != "merge"))
    reader_.fail("#{} may change what follows: {}", directive.text, way_out);
  if (value.is('('))
    for (FoamToken word = value; !word.is(')'); word = reader_.next())
      if (word.kind == Kind::end) reader_.expect(')');  // throws
  if (reader_.peek().is(';')) reader_.next();
}

FoamEntry FoamEntries::read_words() {
  FoamEntry entry;
  const auto add = [&](const FoamToken& word) {
    entry.is_whole = entry.is_whole && entry.words.size() < most_words;
    if (entry.is_whole) entry.words.push_back(word);
  };
  for (int depth = 0;;) {
    const FoamToken word = reader_.next();
    if (depth == 0 && word.is(';')) return entry;
    if (word.kind == Kind::end) reader_.expect(';');  // throws
    depth += word.is('{') ? 1 : word.is('}') ? -1 : 0;
    if (depth < 0) reader_.fail("\";\" is missing");
    const FoamEntry* macro = word.kind == Kind::macro ? find(word.text) : nullptr;
    if (!macro || macro->dictionary) {
      add(word);
    } else {
      entry.is_whole = entry.is_whole && macro->is_whole;
      for (const FoamToken& inner : macro->words) add(inner);
    }
    if (word.kind == Kind::word && word.text.starts_with("List<") && reader_.format().binary) {
      if (!reader_.skip_list(word.text)) reader_.fail("a binary {} cannot be read there", word.text);
      entry.is_whole = false;
    }
  }
}

std::vector<FoamToken> FoamEntries::read_plain_words() {
  FoamEntry entry = read_words();
  if (!entry.is_whole) reader_.fail("a list that is not \"nonuniform\" has too many values");
  for (const FoamToken& word : entry.words) {
    if (word.kind == Kind::macro) reader_.fail("nothing is known of ${}: {}", word.text, way_out);
    if (word.kind == Kind::directive) reader_.fail("#{} is computed by OpenFOAM: {}", word.text, way_out);
  }
  return std::move(entry.words);
}

}  // namespace splatvol
