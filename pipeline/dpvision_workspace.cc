#include "pipeline/dpvision_workspace.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>

#include "core/xml.h"

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot read workspace";
constexpr std::size_t kLargestText = 64u << 20, kLongestToken = 1u << 16, kMostNodes = 100'000;
constexpr int kDeepest = 64;
constexpr double kLargestNumber = 1e7;

struct Token {
  std::string text;
  bool quoted = false;
  std::size_t line = 0;
  bool is(std::string_view word) const { return !quoted && text == word; }
};

/// Words, quoted texts and the four brackets; comments and macros are gone behind it.
class Lexer {
 public:
  Lexer(std::string_view text, std::string name) : text_(text), name_(std::move(name)) {}

  tl::unexpected<Error> bad(std::size_t line, const std::string& why) const {
    return bad_input(kWhat, name_, fmt::format("line {}: {}", line, why));
  }

  /// Nothing at the end.
  Result<std::optional<Token>> next() {
    skip_blank();
    if (at_ >= text_.size()) return std::optional<Token>();
    Token token;
    token.line = line_;
    const char c = text_[at_];
    if (c == '{' || c == '}' || c == '[' || c == ']') {
      token.text = c;
      ++at_;
      return std::optional(token);
    }
    if (c == '"') {
      token.quoted = true;
      GNATHION_CHECK_OK(read_quoted(token));
    } else {
      while (at_ < text_.size() && !ends_word(text_[at_])) token.text += text_[at_++];
    }
    if (token.text.size() > kLongestToken) return bad(token.line, "a word is longer than 64 kB");
    GNATHION_CHECK_OK(expand(token));
    return std::optional(token);
  }

  Status define(const Token& macro, const Token& meaning) {
    if (macro.text.size() < 2 || macro.text[0] != '$') return bad(macro.line, "a macro's name begins with $");
    macros_[macro.text] = meaning.text;
    return macros_.size() <= 1000 ? Status() : bad(macro.line, "more than 1000 macros");
  }
  /// The name of a macro is not itself replaced.
  void raw(bool on) { raw_ = on; }

 private:
  static bool ends_word(char c) {
    return static_cast<unsigned char>(c) <= ' ' || c == '{' || c == '}' || c == '[' || c == ']' || c == '"' ||
           c == '#' || c == ';' || c == ',';
  }

  void skip_blank() {
    for (; at_ < text_.size(); ++at_) {
      const char c = text_[at_];
      if (c == '#')
        while (at_ + 1 < text_.size() && text_[at_ + 1] != '\n') ++at_;
      else if (c == '\n')
        ++line_;
      else if (static_cast<unsigned char>(c) > ' ' && c != ';' && c != ',')
        return;
    }
  }

  Status read_quoted(Token& token) {
    for (++at_; at_ < text_.size() && text_[at_] != '"'; ++at_) {
      if (text_[at_] == '\n') ++line_;
      token.text += text_[at_];
      if (token.text.size() > kLongestToken) return bad(token.line, "a text in quotes does not end");
    }
    if (at_ >= text_.size()) return bad(token.line, "a text in quotes does not end");
    ++at_;
    return {};
  }

  /// Longest names first, once over the text: what a macro stands for is not replaced again.
  Status expand(Token& token) const {
    if (raw_ || macros_.empty() || token.text.find('$') == std::string::npos) return {};
    std::string out;
    for (std::size_t i = 0; i < token.text.size();) {
      const std::pair<const std::string, std::string>* best = nullptr;
      if (token.text[i] == '$')
        for (const auto& macro : macros_)
          if (token.text.compare(i, macro.first.size(), macro.first) == 0 &&
              (best == nullptr || macro.first.size() > best->first.size()))
            best = &macro;
      out += best != nullptr ? best->second : std::string(1, token.text[i]);
      i += best != nullptr ? best->first.size() : 1;
      if (out.size() > kLongestToken) return bad(token.line, "macros make a word longer than 64 kB");
    }
    token.text = std::move(out);
    return {};
  }

  std::string_view text_;
  std::string name_;
  std::size_t at_ = 0, line_ = 1;
  std::map<std::string, std::string> macros_;
  bool raw_ = false;
};

std::optional<double> number_of(const std::string& text) {
  const char *first = text.data(), *last = first + text.size();
  if (first != last && *first == '+') ++first;
  double value = 0;
  const auto [end, ec] = std::from_chars(first, last, value);
  if (ec != std::errc() || end != last || !std::isfinite(value) || std::abs(value) > kLargestNumber)
    return std::nullopt;
  return value;
}

std::vector<std::string> split_keywords(const std::string& text) {
  std::vector<std::string> out;
  std::string word;
  for (const char c : text + ";") {
    if (c != ';' && c != ',') {
      word += c;
      continue;
    }
    while (!word.empty() && word.back() == ' ') word.pop_back();
    while (!word.empty() && word.front() == ' ') word.erase(0, 1);
    if (!word.empty()) out.push_back(word);
    word.clear();
  }
  return out;
}

using Kind = DpNode::Kind;
const std::map<std::string, Kind, std::less<>>& kinds() {
  static const std::map<std::string, Kind, std::less<>> all = {{"transformation", Kind::kTransformation},
                                                               {"trans", Kind::kTransformation},
                                                               {"transform", Kind::kTransformation},
                                                               {"shell", Kind::kShell},
                                                               {"plane", Kind::kPlane},
                                                               {"point", Kind::kPoint},
                                                               {"sphere", Kind::kSphere},
                                                               {"triangle", Kind::kTriangle},
                                                               {"animation", Kind::kAnimation},
                                                               {"motion", Kind::kAnimation},
                                                               {"movement", Kind::kAnimation}};
  return all;
}

/// A matrix, or translations and rotations in turn; a matrix wins over both.
struct Placement {
  Matrix4 steps = Matrix4::Identity();
  std::optional<Matrix4> matrix;
  Matrix4 value() const { return matrix.value_or(steps); }
};

class Parser {
 public:
  Parser(std::string_view text, const std::string& name) : lexer_(text, name) {}

  Result<DpWorkspace> parse() {
    GNATHION_CHECK_OK(advance());
    while (now_) {
      if (now_->is("define")) {
        GNATHION_CHECK_OK(define());
        continue;
      }
      GNATHION_CHECK_OK(object_or_skip(workspace_.nodes));
    }
    return std::move(workspace_);
  }

 private:
  tl::unexpected<Error> bad(const std::string& why) const {
    return lexer_.bad(now_ ? now_->line : last_line_, why);
  }

  Status advance() {
    if (now_) last_line_ = now_->line;
    GNATHION_TRY(now_, lexer_.next());
    return {};
  }

  Status define() {
    lexer_.raw(true);
    GNATHION_CHECK_OK(advance());
    lexer_.raw(false);
    if (!now_) return bad("'define' needs a name and a text");
    const Token macro = *now_;
    GNATHION_CHECK_OK(advance());
    if (!now_) return bad("'define' needs a text");
    GNATHION_CHECK_OK(lexer_.define(macro, *now_));
    return advance();
  }

  Status object_or_skip(std::vector<DpNode>& into) {
    const auto kind = now_->quoted ? kinds().end() : kinds().find(now_->text);
    if (kind == kinds().end()) return skip_unknown();
    if (++nodes_ > kMostNodes) return bad("more than 100,000 objects");
    if (++depth_ > kDeepest) return bad("objects nest deeper than 64");
    into.emplace_back();
    into.back().kind = kind->second;
    const std::string word = now_->text;
    GNATHION_CHECK_OK(advance());
    if (!now_ || !now_->is("{")) return bad(fmt::format("'{}' needs a block in braces", word));
    GNATHION_CHECK_OK(advance());
    GNATHION_CHECK_OK(body(into.back()));
    --depth_;
    return {};
  }

  /// Up to and with the closing brace.
  Status body(DpNode& node) {
    const std::size_t opened = last_line_;
    Placement place;
    while (true) {
      if (!now_) return lexer_.bad(opened, "a block that is opened here does not close");
      if (now_->is("}")) break;
      GNATHION_CHECK_OK(entry(node, place));
    }
    if (node.kind == Kind::kTransformation) node.matrix = place.value();
    return advance();
  }

  Status entry(DpNode& node, Placement& place) {
    if (now_->is("define")) return define();
    if (now_->is("label")) return text_value(node.label);
    if (now_->is("descr")) return text_value(node.description);
    if (now_->is("keywords")) {
      std::string text;
      GNATHION_CHECK_OK(text_value(text));
      node.keywords = split_keywords(text);
      return {};
    }
    if (node.kind == Kind::kShell && now_->is("file")) return text_value(node.file);
    if (is_placement()) return placement(place);
    if (node.kind == Kind::kAnimation && now_->is("sequence")) return sequence(node);
    if (now_->is("center") || now_->is("coords") || now_->is("coordsA")) return three(node.centre_mm);
    if (now_->is("normal") || now_->is("coordsB")) return three(node.normal);
    if (now_->is("coordsC")) return three(node.third_mm);
    if (now_->is("size") || now_->is("radius")) return one(node.size_mm);
    if (node.kind == Kind::kAnimation && now_->is("children")) {
      GNATHION_CHECK_OK(advance());
      if (!now_ || !now_->is("{")) return {};  // its children follow bare
      GNATHION_CHECK_OK(advance());
      while (now_ && !now_->is("}")) GNATHION_CHECK_OK(object_or_skip(node.children));
      return now_ ? advance() : bad("a block does not close");
    }
    return object_or_skip(node.children);
  }

  Status text_value(std::string& to) {
    const std::string word = now_->text;
    GNATHION_CHECK_OK(advance());
    if (!now_ || (!now_->quoted && (now_->is("{") || now_->is("}"))))
      return bad(fmt::format("'{}' needs a text", word));
    to = now_->text;
    return advance();
  }

  Status one(double& to) {
    const std::string word = now_->text;
    GNATHION_CHECK_OK(advance());
    const auto value = now_ ? number_of(now_->text) : std::nullopt;
    if (!value) return bad(fmt::format("'{}' needs a number of at most 1e7", word));
    to = *value;
    return advance();
  }

  /// The numbers in brackets behind a word.
  Status numbers(std::size_t count, double* to) {
    const std::string word = now_->text;
    GNATHION_CHECK_OK(advance());
    if (!now_ || !now_->is("[")) return bad(fmt::format("'{}' needs [{} numbers]", word, count));
    GNATHION_CHECK_OK(advance());
    std::size_t n = 0;
    for (; now_ && !now_->is("]"); ++n) {
      const auto value = number_of(now_->text);
      if (!value) return bad(fmt::format("'{}' is not a number of at most 1e7", now_->text.substr(0, 40)));
      if (n < count) to[n] = *value;
      GNATHION_CHECK_OK(advance());
    }
    if (!now_ || n != count) return bad(fmt::format("'{}' has {} numbers, {} are needed", word, n, count));
    return advance();
  }
  Status three(std::array<double, 3>& to) { return numbers(3, to.data()); }

  bool is_placement() const { return now_->is("matrix") || now_->is("translation") || now_->is("rotation"); }

  Status placement(Placement& place) {
    if (now_->is("matrix")) {
      std::array<double, 16> v{};
      GNATHION_CHECK_OK(numbers(16, v.data()));
      place.matrix = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(v.data());
      return {};
    }
    if (now_->is("translation")) {
      std::array<double, 3> t{};
      GNATHION_CHECK_OK(three(t));
      place.steps = Rigid3::from_translation({t[0], t[1], t[2]}).matrix() * place.steps;
      return {};
    }
    return rotation(place);
  }

  Status rotation(Placement& place) {
    GNATHION_CHECK_OK(advance());
    if (!now_ || !now_->is("{")) return bad("'rotation' needs a block in braces");
    GNATHION_CHECK_OK(advance());
    std::array<double, 3> axis{}, origin{};
    double angle_deg = 0;
    while (now_ && !now_->is("}")) {
      if (now_->is("axis"))
        GNATHION_CHECK_OK(three(axis));
      else if (now_->is("origin"))
        GNATHION_CHECK_OK(three(origin));
      else if (now_->is("angle"))
        GNATHION_CHECK_OK(one(angle_deg));
      else
        GNATHION_CHECK_OK(skip_unknown());
    }
    if (!now_) return bad("a block does not close");
    const Vector3 direction(axis[0], axis[1], axis[2]);
    if (!(direction.norm() > 1e-9)) return bad("a rotation's axis has no direction");
    place.steps =
        Rigid3::about_axis({origin[0], origin[1], origin[2]}, direction, angle_deg * M_PI / 180).matrix() *
        place.steps;
    return advance();
  }

  Status sequence(DpNode& node) {
    GNATHION_CHECK_OK(advance());
    if (!now_ || !now_->is("{")) return bad("'sequence' needs a block in braces");
    GNATHION_CHECK_OK(advance());
    while (now_ && !now_->is("}")) {
      if (!now_->is("frame")) {
        // A frameset's count and time are known, but not how its motion is spread over them.
        GNATHION_CHECK_OK(skip_unknown());
        continue;
      }
      if (node.frames.size() >= 1'000'000) return bad("more than a million frames");
      GNATHION_TRY(DpFrame read, frame());
      node.frames.push_back(std::move(read));
    }
    return now_ ? advance() : bad("a block does not close");
  }

  Result<DpFrame> frame() {
    GNATHION_CHECK_OK(advance());
    if (!now_ || !now_->is("{")) return bad("'frame' needs a block in braces");
    GNATHION_CHECK_OK(advance());
    DpFrame frame;
    Placement place;
    while (now_ && !now_->is("}")) {
      if (now_->is("label"))
        GNATHION_CHECK_OK(text_value(frame.label));
      else if (now_->is("delay") || now_->is("time") || now_->is("time(s)"))
        GNATHION_CHECK_OK(one(frame.duration_s));
      else if (is_placement())
        GNATHION_CHECK_OK(placement(place));
      else
        GNATHION_CHECK_OK(skip_unknown());
    }
    if (!now_) return bad("a block does not close");
    if (frame.duration_s < 0) return bad("a frame's time is negative");
    frame.matrix = place.value();
    GNATHION_CHECK_OK(advance());
    return frame;
  }

  /// A word nobody knows, with what belongs to it as far as the brackets tell.
  Status skip_unknown() {
    if (!now_->is("}") && !now_->is("]") && !now_->is("color") && workspace_.notes.size() < 50)
      workspace_.notes.push_back(fmt::format("line {}: unknown word '{}' is passed over", now_->line,
                                             valid_utf8(now_->text.substr(0, 40))));
    if (now_->is("}") || now_->is("]")) return bad(fmt::format("'{}' closes nothing", now_->text));
    const bool opens = now_->is("{") || now_->is("[");
    if (!opens) GNATHION_CHECK_OK(advance());
    if (!now_ || now_->is("}")) return {};
    if (now_->is("{") || now_->is("[")) return skip_block();
    if (now_->quoted || number_of(now_->text)) return advance();  // its value
    return {};
  }

  Status skip_block() {
    const std::size_t opened = now_->line;
    int open = 0;
    do {
      if (!now_) return lexer_.bad(opened, "a block that is opened here does not close");
      open += now_->is("{") || now_->is("[") ? 1 : now_->is("}") || now_->is("]") ? -1 : 0;
      GNATHION_CHECK_OK(advance());
    } while (open > 0);
    return {};
  }

  Lexer lexer_;
  DpWorkspace workspace_;
  std::optional<Token> now_;
  std::size_t last_line_ = 1, nodes_ = 0;
  int depth_ = 0;
};

}  // namespace

bool DpNode::has_keyword(std::string_view keyword) const {
  return std::find(keywords.begin(), keywords.end(), keyword) != keywords.end();
}

Result<DpWorkspace> parse_dpw(std::string_view text, const std::string& name) {
  if (text.size() > kLargestText) return bad_input(kWhat, name, "is larger than 64 MB");
  if (text.substr(0, 4) == std::string_view("PK\x03\x04", 4))
    return bad_input(kWhat, name, "is a zip: give it the name *.dpvision");
  if (text.find('\0') != std::string_view::npos) return bad_input(kWhat, name, "is no text");
  return Parser(text, name).parse();
}

}  // namespace gnathion
