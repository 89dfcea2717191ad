#include "builder/sources/openfoam/foam_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <system_error>
#include <utility>

#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t longest_word = 4096, most_includes = 1000, deepest_include = 16;

bool is_space(int c) { return c >= 0 && is_white_space(static_cast<char>(c)); }

/// Whether a byte is one of some characters.
bool is_of(int c, std::string_view characters) {
  return c >= 0 && characters.find(static_cast<char>(c)) != std::string_view::npos;
}

/// The numbers of an element of a list of this type; 0: they cannot be counted.
std::size_t numbers_of(std::string_view type) {
  if (type == "List<scalar>" || type == "List<sphericalTensor>") return 1;
  if (type == "List<vector>") return 3;
  return type == "List<symmTensor>" ? 6 : type == "List<tensor>" ? 9 : 0;
}

/// Takes white space and comments. Throws if a comment has no end.
void skip_space_of(FoamStream& stream) {
  for (;;) {
    while (is_space(stream.peek())) stream.take();
    if (stream.peek() != '/') return;
    const std::string_view start = stream.ahead(2);
    if (start == "//") {
      while (stream.peek() >= 0 && stream.peek() != '\n') stream.take();
    } else if (start == "/*") {
      stream.take(2);
      while (stream.ahead(2) != "*/") {
        if (stream.peek() < 0) throw ReaderError("{}: the file is cut off: it ends within a comment", stream.name());
        stream.take();
      }
      stream.take(2);
    } else {
      return;
    }
  }
}

void apply_architecture(std::string_view text, FoamFormat& format) {
  format.big_endian = text.find("MSB") != std::string_view::npos;
  if (text.find("label=64") != std::string_view::npos) format.label_bytes = 8;
  if (text.find("scalar=32") != std::string_view::npos) format.scalar_bytes = 4;
}

}  // namespace

FoamReader::FoamReader(const FoamPlace& place) : case_folder_(place.case_folder) {
  auto stream = std::make_unique<FoamStream>(place.path, place.name);
  if (stream->peek() < 0) throw ReaderError("{}: the file is empty", place.name);
  std::error_code error;
  sources_.push_back({std::move(stream), {}, folder_of(place.path), fs::canonical(place.path, error).string()});
  read_header();
  if (!place.block) return;
  if (class_ != "decomposedBlockData") throw ReaderError("{}: no file of several processors", place.name);
  enter_block(*place.block);
}

void FoamReader::read_header() {
  skip_space();
  constexpr std::string_view name = "FoamFile";
  const std::string_view start = stream().ahead(name.size());
  if (start.size() < name.size() && name.starts_with(start))
    throw ReaderError("{}: the file is cut off within its header", stream().name());
  if (start != name) return;
  const auto cut_or = [&](FoamToken token) {
    if (token.kind == FoamToken::Kind::end)
      throw ReaderError("{}: the file is cut off within its header", stream().name());
    return token;
  };
  next();
  expect('{');
  FoamFormat& format = sources_.back().format;
  for (FoamToken key = cut_or(next()); !key.is('}'); key = cut_or(next())) {
    if (peek().is('{')) {
      next();
      skip_block();
      continue;
    }
    const FoamToken value = cut_or(next());
    if (key.is_word("class")) class_ = value.text;
    if (key.is_word("data.class")) inner_class_ = value.text;
    if (key.is_word("format")) format.binary = value.text == "binary";
    if (key.is_word("data.format")) inner_is_binary_ = value.text == "binary";
    if (key.is_word("arch")) apply_architecture(value.text, format);
    for (FoamToken end = value; !end.is(';');) end = cut_or(next());
  }
  if (class_.empty()) throw ReaderError("{}: its header states no class", stream().name());
}

/// Skips the blocks of the processors before one. The first block may have a header, which is that of all.
void FoamReader::enter_block(std::size_t block) {
  class_ = inner_class_;
  sources_.back().format.binary = inner_is_binary_;
  for (std::size_t i = 0;; ++i) {
    FoamToken size = next();
    if (size.kind == FoamToken::Kind::end)
      throw ReaderError("{}: it holds {} processors only: processor {} is missing", stream().name(), i, block);
    if (size.text.starts_with("List<")) size = next();
    const auto bytes = number_of<std::uint64_t>(size.text);
    expect('(');
    const std::uint64_t begin = stream().taken();
    if (!bytes || *bytes > stream().most_left())
      throw ReaderError("{}: the file is cut off or damaged: the block of processor {} ends early", stream().name(), i);
    if (i == 0) read_header();
    const std::uint64_t taken = stream().taken() - begin;
    if (taken > *bytes || class_.empty())
      throw ReaderError("{}: the block of processor {} is damaged", stream().name(), i);
    if (i == block) return stream().end_after(*bytes - taken);
    stream().skip(*bytes - taken);
    expect(')');
  }
}

void FoamReader::fail_with(fmt::string_view text, fmt::format_args arguments) const {
  const FoamStream& stream = *sources_.back().stream;
  throw ReaderError("{}: line {}: {}", stream.name(), stream.line(), fmt::vformat(text, arguments));
}

void FoamReader::skip_space() { skip_space_of(stream()); }

void FoamReader::expect(char mark) {
  const FoamToken token = next();
  if (token.is(mark)) return;
  if (token.kind == FoamToken::Kind::end)
    throw ReaderError("{}: the file is cut off: it ends where \"{}\" must stand", stream().name(), mark);
  fail("\"{}\" must stand there, and not \"{}\"", mark, token.text.substr(0, 40));
}

FoamToken FoamReader::peek() {
  if (!peeked_) peeked_ = next();
  return *peeked_;
}

FoamToken FoamReader::next() {
  if (peeked_) return *std::exchange(peeked_, std::nullopt);
  for (;;) {
    FoamToken token = read_token();
    if (token.kind == FoamToken::Kind::end && sources_.size() > 1) {
      sources_.pop_back();
      continue;
    }
    const bool optional = token.text == "includeIfPresent" || token.text == "sinclude";
    if (token.kind != FoamToken::Kind::directive || !follows_includes_ || (token.text != "include" && !optional))
      return token;
    const FoamToken file = read_token();
    if (file.kind != FoamToken::Kind::text && file.kind != FoamToken::Kind::word) fail("#include names no file");
    include(file.text, optional);
  }
}

FoamToken FoamReader::read_token() {
  using Kind = FoamToken::Kind;
  skip_space();
  const int c = stream().peek();
  if (c < 0) return {};
  if (c == '"') return read_text();
  if (is_of(c, "{}()[];")) {
    stream().take();
    return {Kind::mark, std::string(1, static_cast<char>(c))};
  }
  if (c != '$' && c != '#') return read_word();
  stream().take();
  if (stream().peek() == '{') return c == '$' ? read_braces() : skip_code();
  FoamToken word = read_word();
  word.kind = c == '$' ? Kind::macro : Kind::directive;
  return word;
}

/// Reads `${name}` behind its `$`.
FoamToken FoamReader::read_braces() {
  FoamToken token{FoamToken::Kind::macro, {}};
  stream().take();
  for (int c = stream().peek(); c != '}'; c = stream().peek()) {
    if (c < 0) throw ReaderError("{}: the file is cut off: it ends within braces", stream().name());
    if (token.text.size() < longest_word) token.text += static_cast<char>(c);
    stream().take();
  }
  stream().take();
  return token;
}

/// Takes code, `#{ ... #}`, behind its `#`.
FoamToken FoamReader::skip_code() {
  while (stream().ahead(2) != "#}") {
    if (stream().peek() < 0) throw ReaderError("{}: the file is cut off: it ends within code", stream().name());
    stream().take();
  }
  stream().take(2);
  return {FoamToken::Kind::directive, "{"};
}

FoamToken FoamReader::read_text() {
  FoamToken token{FoamToken::Kind::text, {}};
  stream().take();
  for (int c = stream().peek(); c != '"'; c = stream().peek()) {
    if (c == '\\') {
      stream().take();
      c = stream().peek();
    }
    if (c < 0) throw ReaderError("{}: the file is cut off: it ends within quotation marks", stream().name());
    if (token.text.size() < longest_word) token.text += static_cast<char>(c);
    stream().take();
  }
  stream().take();
  return token;
}

/// A word ends at white space, a quotation mark, or one of { } ; and at brackets that it does not open, as those of
/// "div(phi)" are. Numbers open none.
FoamToken FoamReader::read_word() {
  FoamToken token{FoamToken::Kind::word, {}};
  int open = 0;
  const int first = stream().peek();
  bool number = is_of(first, "0123456789+-.");
  for (int c = stream().peek(); c >= 0 && !is_space(c) && c != '"' && c != '{' && c != '}' && c != ';';
       c = stream().peek()) {
    if (c == '(' && (number || token.text.empty())) break;
    open += c == '(' ? 1 : c == ')' ? -1 : 0;
    if (open < 0) break;
    number = number && is_of(c, "0123456789+-.eE");
    if (c == '/' && (stream().ahead(2) == "//" || stream().ahead(2) == "/*")) break;
    if (token.text.size() < longest_word) token.text += static_cast<char>(c);
    stream().take();
  }
  return token;
}

bool FoamReader::skip_list(const std::string& type) {
  if (!format().binary || is_one_of(type, {"List<word>", "List<string>", "List<fileName>"})) return true;
  const std::size_t numbers = numbers_of(type);
  const bool labels = type == "List<label>";
  if (numbers == 0 && !labels) {
    if (stream().peek() < 0) throw ReaderError("{}: the file is cut off: it ends within a list", stream().name());
    return false;
  }
  const FoamToken count = next();
  const auto elements = number_of<std::uint64_t>(count.text);
  if (!elements) fail("the number of values in a list is \"{}\"", count.text.substr(0, 40));
  skip_space();
  if (stream().peek() != '(' || *elements == 0) return true;
  stream().take();
  const auto bytes = static_cast<std::uint64_t>(labels ? format().label_bytes : format().scalar_bytes) *
                     std::max<std::size_t>(numbers, 1);
  if (*elements > stream().most_left() / bytes)
    throw ReaderError("{}: the file is cut off or damaged: a list has not {} values", stream().name(), *elements);
  stream().skip(*elements * bytes);
  expect(')');
  return true;
}

bool FoamReader::skip_entry() { return skip_until(';'); }
bool FoamReader::skip_block() { return skip_until('}'); }

bool FoamReader::skip_until(char end) {
  int depth = 0;
  for (;;) {
    const FoamToken token = next();
    if (token.kind == FoamToken::Kind::end)
      throw ReaderError("{}: the file is cut off: it ends where \"{}\" must stand", stream().name(), end);
    if (depth == 0 && token.is(end)) return true;
    depth += token.is('{') ? 1 : token.is('}') ? -1 : 0;
    if (depth < 0) fail("a brace is closed that is not open");
    if (token.kind == FoamToken::Kind::word && token.text.starts_with("List<") && !skip_list(token.text)) return false;
  }
}

std::string FoamReader::resolve(const std::string& file) const {
  for (const std::string_view root : {"$FOAM_CASE", "${FOAM_CASE}", "<case>"})
    if (file.starts_with(root)) return case_folder_ + "/" + file.substr(root.size());
  for (const std::string_view root : {"system", "constant"})
    if (file.starts_with(fmt::format("<{}>", root)))
      return case_folder_ + "/" + std::string(root) + file.substr(root.size() + 2);
  return fs::path(file).is_absolute() ? file : sources_.back().folder + "/" + file;
}

void FoamReader::include(const std::string& file, bool optional) {
  const std::string path = resolve(file);
  std::error_code error;
  if (path.find('$') != std::string::npos)
    fail("the file \"{}\" is named by a variable: write the case out by foamDictionary -expand", file);
  if (!fs::exists(path, error)) {
    if (optional) return;
    fail("the file \"{}\", which it includes, is missing", file);
  }
  auto stream = std::make_unique<FoamStream>(path, file);
  const std::string canonical = fs::canonical(path, error).string();
  const std::string root = fs::canonical(case_folder_, error).string() + "/";
  if (error || !canonical.starts_with(root)) fail("it includes \"{}\", which lies outside of the case", file);
  if (std::ranges::find(sources_, canonical, &Source::canonical) != sources_.end())
    fail("it includes \"{}\", which includes it", file);
  if (sources_.size() > deepest_include) fail("files include each other more than {} deep", deepest_include);
  if (++files_ > most_includes) fail("it includes more than {} files", most_includes);
  sources_.push_back({std::move(stream), {}, folder_of(path), canonical});
}

bool has_foam_header(const FoamPlace& place) {
  FoamStream stream(place.path, place.name);
  if (stream.peek() < 0) throw ReaderError("{}: the file is empty", place.name);
  if (place.path.ends_with(".gz") && !stream.is_packed())
    throw ReaderError("{}: the file is cut off, or not packed by gzip", place.name);
  if (stream.ahead(8).find_first_not_of('\0') == std::string_view::npos)
    throw ReaderError("{}: the file is damaged: it begins with zeros in place of its header", place.name);
  skip_space_of(stream);
  return std::string_view("FoamFile").starts_with(stream.ahead(8));
}

}  // namespace splatvol
