#include "tools/command_line.h"

#include <CLI/CLI.hpp>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>

namespace splatvol {

CommandOption* CommandOption::required(bool is_required) {
  option_.required(is_required);
  return this;
}

CommandOption* CommandOption::type_name(const std::string& name) {
  option_.type_name(name);
  return this;
}

CommandOption* CommandOption::check(OptionCheck check, const std::string& values) {
  option_.check(CLI::Validator([check = std::move(check)](std::string& text) { return check(text); }, values));
  return this;
}

template <class T>
CommandOption* CommandOption::range(T low, T high) {
  option_.check(CLI::Range(low, high));
  return this;
}
template CommandOption* CommandOption::range(int, int);
template CommandOption* CommandOption::range(unsigned, unsigned);
template CommandOption* CommandOption::range(std::uint64_t, std::uint64_t);
template CommandOption* CommandOption::range(double, double);

CommandOption* CommandOption::not_negative() {
  option_.check(CLI::NonNegativeNumber);
  return this;
}

CommandOption* CommandOption::one_of(std::vector<std::string> values) {
  option_.check(CLI::IsMember(std::move(values)));
  return this;
}

CommandOption* CommandOption::existing_folder() {
  option_.check(CLI::ExistingDirectory);
  return this;
}

CommandOption* CommandOption::excludes(CommandOption* other) {
  option_.excludes(&other->option_);
  return this;
}

CommandOption* CommandOption::needs(CommandOption* other) {
  option_.needs(&other->option_);
  return this;
}

CommandOption* CommandOption::capture_default_str() {
  option_.capture_default_str();
  return this;
}

CommandOption* CommandOption::default_str(const std::string& text) {
  option_.default_str(text);
  return this;
}

CommandOption* CommandOption::delimiter(char character) {
  option_.delimiter(character);
  return this;
}

CommandOption* CommandOption::expected(int count) {
  option_.expected(count);
  return this;
}

CommandOption* CommandOption::allow_extra_args(bool allowed) {
  option_.allow_extra_args(allowed);
  return this;
}

CommandOption* CommandOption::group(const std::string& heading) {
  option_.group(heading);
  return this;
}

bool CommandOption::is_given() const { return !option_.empty(); }

CommandLine::CommandLine(const std::string& description, const std::string& name)
    : app_(std::make_shared<CLI::App>(description, name)) {}

template <class T>
CommandOption* CommandLine::add_option(const std::string& names, T& target, const std::string& description) {
  return keep(app_->add_option(names, target, description));
}
template CommandOption* CommandLine::add_option(const std::string&, std::string&, const std::string&);
template CommandOption* CommandLine::add_option(const std::string&, double&, const std::string&);
template CommandOption* CommandLine::add_option(const std::string&, int&, const std::string&);
template CommandOption* CommandLine::add_option(const std::string&, unsigned&, const std::string&);
template CommandOption* CommandLine::add_option(const std::string&, std::uint64_t&, const std::string&);
template CommandOption* CommandLine::add_option(const std::string&, std::optional<double>&, const std::string&);
template CommandOption* CommandLine::add_option(const std::string&, std::optional<std::string>&, const std::string&);
template CommandOption* CommandLine::add_option(const std::string&, std::optional<int>&, const std::string&);
template CommandOption* CommandLine::add_option(const std::string&, std::optional<std::size_t>&, const std::string&);
template CommandOption* CommandLine::add_option(const std::string&, std::vector<double>&, const std::string&);
template CommandOption* CommandLine::add_option(const std::string&, std::vector<std::string>&, const std::string&);

CommandOption* CommandLine::add_flag(const std::string& names, bool& target, const std::string& description) {
  return keep(app_->add_flag(names, target, description));
}

CommandOption* CommandLine::add_flag(const std::string& names, std::function<void()> given,
                                     const std::string& description) {
  return keep(app_->add_flag_callback(names, std::move(given), description));
}

CommandOption* CommandLine::get_option(const std::string& name) { return keep(app_->get_option(name)); }

CommandLine* CommandLine::add_subcommand(const std::string& name, const std::string& description) {
  // The program's own command line owns it.
  const std::shared_ptr<CLI::App> subcommand(app_, app_->add_subcommand(name, description));
  subcommands_.push_back(CommandLine(subcommand));
  return &subcommands_.back();
}

void CommandLine::require_subcommand() { app_->require_subcommand(1); }

bool CommandLine::is_given() const { return app_->parsed(); }

std::string CommandLine::get_name() const { return app_->get_name(); }

void CommandLine::description(const std::string& text) { app_->description(text); }

void CommandLine::callback(std::function<void()> check) { app_->callback(std::move(check)); }

void missing_option(const std::string& name) { throw CLI::RequiredError(name); }

void wrong_option(const std::string& name, const std::string& reason) { throw CLI::ValidationError(name, reason); }

std::string check_range(const std::string& text, int low, int high) { return CLI::Range(low, high)(text); }

}  // namespace splatvol
