// SPDX-License-Identifier: Apache-2.0
//
// The report as one HTML document without other files and scripts. Headings are in order, tables have captions and
// scopes, drawings have descriptions, and no fact is shown by colour alone.
#include <fmt/core.h>

#include <map>

#include "base/durable.h"
#include "report/content.h"

namespace slabd::report {
namespace {

constexpr std::string_view kStyle = R"(
:root { color-scheme: light; }
body { font: 15px/1.45 "DejaVu Sans", "Noto Sans CJK SC", sans-serif; color: #111; background: #fff;
  max-width: 62rem; margin: 1.5rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; margin: 0; } h2 { font-size: 1.15rem; margin: 2rem 0 .4rem; border-bottom: 1px solid #777; }
p { margin: .3rem 0; }
table { border-collapse: collapse; margin: .6rem 0 1rem; width: 100%; font-size: .86rem; }
caption { text-align: left; font-weight: bold; padding: .2rem 0; }
th, td { padding: .18rem .45rem; border-bottom: 1px solid #ccc; text-align: right; font-variant-numeric: tabular-nums; }
th.words, td.words { text-align: left; overflow-wrap: anywhere; }
thead th { background: #e6e8ec; } tbody th { font-weight: normal; }
tr.fail > * { background: #fadcdc; font-weight: bold; } tr.indeterminate > * { background: #fff2cc; }
.verdict { padding: .5rem .9rem; border: 1px solid #000; font-size: 1.3rem; font-weight: bold; margin: .8rem 0; }
.pass { background: #d6f0de; color: #0d592e; } p.fail, div.fail { background: #9e0d1a; color: #fff; }
p.fail { padding: .1rem .5rem; } .indeterminate { background: #facc5c; color: #402900; }
.not_measured, .aborted { background: #8c80a8; color: #000; }
figure { display: inline-block; margin: .6rem 1rem .6rem 0; vertical-align: top; }
figcaption { font-weight: bold; font-size: .86rem; } svg { max-width: 100%; height: auto; }
.warning::before { content: "⚠ "; }
.emulated { padding: .4rem .9rem; border: 3px double #9e0d1a; color: #9e0d1a; font-weight: bold; }
.watermark { position: fixed; inset: 0; z-index: -1; display: flex; align-items: center; justify-content: center;
  font-size: 14vw; font-weight: bold; color: #f3e3e3; transform: rotate(-35deg); }
@media print { h2 { break-after: avoid; } tr, figure { break-inside: avoid; } }
)";

std::string_view sign(Verdict verdict) {
  switch (verdict) {
    case Verdict::pass: return "✓ ";
    case Verdict::fail: return "✗ ";
    case Verdict::indeterminate: return "? ";
    case Verdict::not_measured: return "∅ ";
    case Verdict::aborted: return "⊘ ";
    case Verdict::none: break;
  }
  return "";
}

std::string escaped(std::string_view text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&': out += "&amp;"; break;
      case '<': out += "&lt;"; break;
      case '>': out += "&gt;"; break;
      case '"': out += "&quot;"; break;
      // A path may contain any byte, and HTML does not allow control characters.
      default: out += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
    }
  }
  return out;
}

/// The drawings contain text as outlines, each with the outline of every letter it uses. The document stores each
/// outline once; later drawings refer to the first one's.
class Letters {
 public:
  std::string share(const std::string& svg) {
    static constexpr std::string_view kBegin = "<symbol ";
    static constexpr std::string_view kEnd = "</symbol>\n";
    std::map<std::string, std::string, std::less<>> renamed;
    std::string out;
    std::size_t at = 0;
    for (std::size_t begin = svg.find(kBegin); begin != std::string::npos; begin = svg.find(kBegin, at)) {
      const std::size_t end = svg.find(kEnd, begin);
      const std::size_t id = svg.find("id=\"", begin) + 4;
      const std::size_t id_end = svg.find('"', id);
      const std::size_t body = svg.find('>', begin);
      if (end == std::string::npos || id_end > body) break;  // not in this library's format: left as it is
      const std::string name = svg.substr(id, id_end - id);
      const auto [known, fresh] = first_.try_emplace(svg.substr(body, end - body), name);
      out.append(svg, at, (fresh ? end + kEnd.size() : begin) - at);
      if (!fresh) renamed.emplace(name, known->second);
      at = end + kEnd.size();
    }
    out.append(svg, at);
    return with_references(out, renamed);
  }

 private:
  static std::string with_references(const std::string& svg,
                                     const std::map<std::string, std::string, std::less<>>& renamed) {
    static constexpr std::string_view kReference = "xlink:href=\"#";
    std::string out;
    std::size_t at = 0;
    for (std::size_t found = svg.find(kReference); found != std::string::npos; found = svg.find(kReference, at)) {
      const std::size_t name = found + kReference.size();
      const std::size_t end = svg.find('"', name);
      const auto other = renamed.find(std::string_view(svg).substr(name, end - name));
      out.append(svg, at, name - at);
      out += other == renamed.end() ? svg.substr(name, end - name) : other->second;
      at = end;
    }
    return out.append(svg, at);
  }

  std::map<std::string, std::string> first_;  ///< outline -> its id
};

class Writer {
 public:
  explicit Writer(const Report& report) : report_(report) {}

  std::string document() {
    out_ = fmt::format(
        "<!DOCTYPE html>\n<html lang=\"{}\">\n<head>\n<meta charset=\"utf-8\">\n"
        "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{}, {}</title>\n"
        "<style>{}</style>\n</head>\n<body>\n<main>\n<h1>{}</h1>\n<p>{}</p>\n",
        code(report_.language), escaped(report_.title), escaped(report_.subject), kStyle, escaped(report_.title),
        escaped(report_.subject));
    // Fixed: a browser prints it on every page.
    if (report_.emulated != 0)
      out_ += fmt::format("<div class=\"watermark\" aria-hidden=\"true\">{}</div>\n<p class=\"emulated\">{}</p>\n",
                          emulation_mark(report_.emulated, report_.language),
                          escaped(emulation_notice(report_.emulated, report_.language)));
    if (report_.judged)
      out_ += fmt::format(
          "<p class=\"verdict {}\">{}{}{}</p>\n", name(report_.verdict), sign(report_.verdict),
          report_.open ? word(Word::still_open, report_.language) : verdict_word(report_.verdict, report_.language),
          report_.emulated != 0 ? fmt::format(" ({})", emulation_mark(report_.emulated, report_.language)) : "");
    for (const Section& section : report_.sections) write(section);
    out_ += "</main>\n</body>\n</html>\n";
    return std::move(out_);
  }

 private:
  void write(const Section& section) {
    if (section.parts.empty()) return;
    out_ += "<section>\n";
    if (!section.title.empty()) {
      std::string title = std::string(sign(section.verdict)) + section.title;
      if (section.verdict != Verdict::none)
        title += fmt::format(": {}", verdict_word(section.verdict, report_.language));
      if (!section.remark.empty()) title += " – " + section.remark;
      out_ += fmt::format("<h2>{}</h2>\n", escaped(title));
    }
    for (const Part& part : section.parts) std::visit([&](const auto& p) { write(p); }, part);
    out_ += "</section>\n";
  }

  void write(const Paragraph& paragraph) {
    const std::string_view style = paragraph.verdict != Verdict::none ? name(paragraph.verdict)
                                   : paragraph.warning                ? "warning"
                                                                      : "plain";
    std::string text = escaped(paragraph.text);
    if (paragraph.verdict != Verdict::none)
      text = fmt::format("{}{}: {}", sign(paragraph.verdict), verdict_word(paragraph.verdict, report_.language), text);
    out_ += fmt::format("<p class=\"{}\">{}</p>\n", style, text);
  }

  void write(const Table& whole) {
    const Table table = visible(whole);
    const auto kind = [&](std::size_t c) { return c == 0 || table.columns[c].left ? " class=\"words\"" : ""; };
    out_ += fmt::format("<table>\n<caption>{}</caption>\n<thead><tr>", escaped(table.title));
    for (std::size_t c = 0; c < table.columns.size(); ++c)
      out_ += fmt::format("<th scope=\"col\"{}>{}</th>", kind(c), escaped(table.columns[c].heading));
    out_ += "</tr></thead>\n<tbody>\n";
    for (const Table::Row& row : table.rows) {
      const Verdict verdict = verdict_of(row);
      out_ += verdict == Verdict::none ? "<tr>" : fmt::format("<tr class=\"{}\">", name(verdict));
      for (std::size_t c = 0; c < row.size(); ++c)
        out_ += fmt::format("<{0}{1}>{2}{3}</{4}>", c == 0 ? "th scope=\"row\"" : "td", kind(c),
                            sign(row[c].verdict.value_or(Verdict::none)), escaped(row[c].text), c == 0 ? "th" : "td");
      out_ += "</tr>\n";
    }
    out_ += "</tbody>\n</table>\n";
  }

  void write(const Figures& figures) {
    for (const Figure& figure : figures.list) {
      const std::string id = fmt::format("f{}", ++figures_);
      std::string svg = letters_.share(svg_of(figure, id + "-"));
      const std::size_t end = svg.find('>');
      if (end == std::string::npos) continue;
      svg.insert(end + 1, fmt::format("<desc id=\"{}-alt\">{}</desc>", id, escaped(figure.alt)));
      svg.insert(4, fmt::format(" role=\"img\" aria-label=\"{}\"", escaped(figure.alt)));
      out_ += fmt::format("<figure>\n<figcaption>{}</figcaption>\n{}</figure>\n", escaped(figure.title), svg);
    }
  }

  const Report& report_;
  std::string out_;
  Letters letters_;
  int figures_ = 0;
};

}  // namespace

std::string html(const Report& report) {
  return Writer(report).document();
}

Status write_html(const Report& report, const std::string& path) {
  OutFile out(path, {.synced = true});
  out.write(html(report));
  return out.close();
}

}  // namespace slabd::report
