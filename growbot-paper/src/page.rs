//! An HTML page with all results. It needs no other file and no network.

use std::fmt::Write;

use growbot_core::plan::Planner;
use growbot_plan::table::{NumberFormat, Table};

use super::comparison::{ExactErrors, SignificanceTest};
use super::experiments::{ErrorQuantity, GrowthSet, NOISE_OF_FEEDBACK};
use super::figures::Figure;
use super::paper::{self, GROUPS, MeanSd, ROBOTS};
use super::reproduction::Reproduction;
use super::slicing_rule::SlicingRule;
use super::statistics::{SampleSummary, TestResult};
use super::summary::error_text;
use super::table2::Cell;
use super::tables::{Parameters, parameters};
use super::texts::{capital, p_text};

const STYLE: &str = include_str!("page.css");

// Writing to a String cannot fail, so the results of `writeln!` are ignored.

/// Returns the page as HTML. `command` is a command line that makes it again.
pub fn html(of: &Reproduction, figures: &[Figure], command: &str) -> String {
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>Growing from the tip: the paper&#8217;s experiments, done \
         again</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n"
    );
    introduction(&mut page, of, command);
    differences(&mut page, of);
    for table in [1, 3].into_iter().filter(|table| of.request.has_table(*table)) {
        robots(&mut page, of, table);
    }
    if of.request.has_table(2) {
        table2(&mut page, of);
    }
    tests(&mut page, of);
    feedback(&mut page, of);
    for figure in figures {
        let _ = writeln!(
            page,
            "<h2 id=\"figure{}\">{}</h2>\n<p>{}</p>",
            figure.number,
            figure.title,
            caption(figure.number)
        );
        let _ = writeln!(page, "<figure>\n{}</figure>", figure.svg);
    }
    page.push_str("</body>\n</html>\n");
    page
}

fn introduction(page: &mut String, of: &Reproduction, command: &str) {
    let request = &of.request;
    let _ = writeln!(
        page,
        "<h1>Growing from the tip: the paper&#8217;s experiments, done again</h1>\n\
         <p class=\"soft\">Del Dottore, Mondini, Sadeghi, Mazzolai: Characterization of the Growing From the Tip as \
         Robot Locomotion Strategy. Front. Robot. AI 6:45, 2019, doi 10.3389/frobt.2019.00045. By growbot {}, seed {}: \
         <code>{command}</code> gives this page again, to the byte.</p>",
        env!("CARGO_PKG_VERSION"),
        request.seed
    );
    let _ = writeln!(
        page,
        "<p>Each growth is planned from a random start to a random goal, sliced into layers, laid layer by layer by \
         the kinematics of growth (Eq 4, corrected), and compared with its goal: position error over the length of the \
         path (Eq 26), heading and pitch error (Eqs 27 and 28, wrapped to half a turn). {} growths in each group, {} \
         at each level of noise.</p>",
        request.repeat, request.repeat_noise
    );
    page.push_str(
        "<ul>\n<li><b>Poses.</b> The paper chooses &#8220;a completely random&#8221; start and target pose and does \
         not say how. Here the goal lies anywhere on the sphere round the start whose radius is the distance of the \
         group (4, 8, 16 or 32 R, where R is the radius of the arcs), and both directions are uniform on the sphere. \
         The position of the start has no influence.</li>\n\
         <li><b>Steps.</b> The paper lays whole steps and rounds their number up. It gives two heights for robots A to \
         A8: 0.3096 cm in the text, 0.0774 cm in Table 1. Both are shown. For robots B and C the paper gives \
         only the heights of Table 3. A segment whose length is zero except for rounding gets no step.</li>\n\
         <li><b>Exact slicing.</b> This is growbot&#8217;s own method: each segment is sliced into equal layers, and \
         the last layer ends where the segment ends.</li>\n\
         <li><b>Planners.</b> <i>two-plane</i> is the paper&#8217;s planner: two planar Dubins paths that meet on the \
         line from start to goal. <i>shortest</i> is growbot&#8217;s own planner.</li>\n\
         <li><b>Closed loop.</b> This is growbot&#8217;s own method: after each layer its growth (odometry, standard \
         deviation 1 % of the layer) and the tip&#8217;s direction (0.5 degrees about each of two axes) are measured, \
         and the rest of the path is planned again.</li>\n\
         <li><b>Numbers.</b> Mean &plusmn; standard deviation. All numbers, also those of each single growth, are in \
         the CSV files beside this page.</li>\n</ul>\n",
    );
    if let Some(ExactErrors { max_position, max_direction, growths }) = of.comparison.exact {
        let _ = writeln!(
            page,
            "<p><b>With exact slicing and without noise the goal is reached:</b> none of {growths} growths of all \
             robots here ended further from its goal than {max_position:.1e} of its length and {max_direction:.1e} \
             rad. What the paper reports as the error of the model is caused by rounding up the number of steps.</p>"
        );
    }
}

fn differences(page: &mut String, of: &Reproduction) {
    if of.comparison.differences.is_empty() {
        return;
    }
    page.push_str(
        "<h2 id=\"differences\">Where we differ, by how much, and why</h2>\n<div class=\"wide\"><table>\n\
         <tr><th class=\"l\">what</th><th class=\"l\">by how much</th><th class=\"l\">why, as far as we can \
         tell</th></tr>\n",
    );
    for difference in &of.comparison.differences {
        let _ = writeln!(
            page,
            "<tr><td class=\"w\">{}</td><td class=\"w\">{}</td><td class=\"w\">{}</td></tr>",
            capital(difference.what),
            difference.by.replace('<', "&lt;").replace("+-", "&plusmn;"),
            difference.why
        );
    }
    page.push_str("</table></div>\n");
}

fn robots(page: &mut String, of: &Reproduction, table: u8) {
    let title = if table == 1 { "robots A to A8" } else { "robots A, B and C" };
    let _ = writeln!(
        page,
        "<h2 id=\"table{table}\">Table {table}: {title}</h2>\n\
         <p>The values are those of the robots&#8217; descriptions, which are the paper&#8217;s numbers. &phi; = g / R \
         and k = g &Delta;t / R are computed from them; where the paper prints another value, this value is in \
         brackets.{}</p>",
        if table == 3 {
            " The &phi; that the paper prints for B and C does not agree with its own g and R, but its k does."
        } else {
            " The text&#8217;s &phi; = 0.025/s is in degrees: 0.45 degrees in 18 s."
        }
    );
    // Values are printed with at most four decimals, so a smaller difference is not visible.
    let beside = |ours: f64, printed: f64| {
        let same = (ours - printed).abs() <= 0.6e-4_f64.max(0.002 * ours);
        let digits = if ours < 0.00095 { 6 } else { 4 };
        if same { format!("{ours:.digits$}") } else { format!("{ours:.digits$} ({printed})") }
    };
    let robots = Table::new(NumberFormat::Plain)
        .column("robot", |of: &Parameters| of.paper.name)
        .column("&Delta;t, s", |of| of.dt_s)
        .column("g, mm/s", |of| libm::round(1e6 * of.g_mm_per_s()) / 1e6)
        .column("R, mm", |of| of.radius_mm)
        .column("r<sub>t</sub>, mm", |of| of.tip_radius_mm)
        .column("step, mm", |of| of.step_mm)
        .column("&phi;, rad/s", move |of| beside(of.phi_rad_per_s(), of.paper.phi_rad_per_s))
        .column("k, rad a step", move |of| beside(of.k(), of.paper.k));
    *page += &robots.html(parameters(of, table), 1);
}

fn table2(page: &mut String, of: &Reproduction) {
    page.push_str(
        "<h2 id=\"table2\">Table 2: position error over the length of the path</h2>\n\
         <p>Open loop, without noise. Below each of our means are two p-values. <i>Welch</i>: the p-value of \
         Welch&#8217;s t-test that our mean and the mean of the paper&#8217;s 50 growths do not differ. <i>TOST</i>: \
         the p-value of two one-sided tests that the means differ by more than the paper&#8217;s standard deviation; \
         a small value shows that the means are equivalent within this margin. Both are corrected by Holm&#8217;s \
         method for all means with the path and layers of the row, over all robots. <span class=\"out\">Red, \
         *</span>: the means differ at the level of 5 %. <span class=\"in\">Green, =</span>: the means are equivalent \
         at the level of 5 %. A mean may be both, if a difference is certain but is certainly below the margin. \
         <i>&plusmn; SD</i>: our mean lies within the paper&#8217;s mean &plusmn; its standard deviation, which is not \
         a test.</p>\n<div \
         class=\"wide\"><table>\n<tr><th class=\"l\">robot</th><th class=\"l\">path</th><th class=\"l\">layers</th>",
    );
    for group in GROUPS {
        let _ = write!(page, "<th>{group} R</th>");
    }
    page.push_str("</tr>\n");
    for (robot, printed) in ROBOTS.iter().enumerate() {
        let Some(numbers) = printed.position_error else { continue };
        let _ = write!(
            page,
            "<tr class=\"first paper\"><td class=\"l\">{}</td><td class=\"l\" colspan=\"2\">the paper</td>",
            printed.name
        );
        for MeanSd { mean, sd } in numbers {
            let _ = write!(page, "<td>{mean:.4} &plusmn; {sd:.4}</td>");
        }
        page.push_str("</tr>\n");
        for planner in [Planner::TwoPlane, Planner::Shortest] {
            for slicing in SlicingRule::of_robot(robot) {
                let cells: Vec<&Cell> = of
                    .comparison
                    .table2
                    .iter()
                    .filter(|cell| (cell.robot, cell.planner, cell.slicing) == (robot, planner, *slicing))
                    .collect();
                let _ = write!(
                    page,
                    "<tr><td></td><td class=\"l\">{}</td><td class=\"l\">{}</td>",
                    planner.name(),
                    slicing.label(&of.experiments.robots[robot])
                );
                for cell in cells {
                    let _ = write!(page, "<td>{}<br>{}</td>", mean_and_sd(&cell.ours), verdict(cell));
                }
                page.push_str("</tr>\n");
            }
        }
    }
    page.push_str("</table></div>\n");
}

/// Returns the p-values of a mean, marked if the test finds a difference or an equivalence.
fn verdict(cell: &Cell) -> String {
    let Some(tests) = &cell.tests else { return "-".to_owned() };
    let p = |p: f64| p_text(p).replace('<', "&lt;");
    let marked = |holds: bool, class: &str, mark: &str, text: String| {
        if holds { format!("<span class=\"{class}\">{text} {mark}</span>") } else { text }
    };
    let welch = marked(tests.differs(), "out", "*", format!("Welch {}", p(tests.p_holm)));
    let tost = marked(tests.is_equivalent(), "in", "=", format!("TOST {}", p(tests.tost_p_holm)));
    let within = if cell.is_within() { "<br>&plusmn; SD" } else { "" };
    format!("<small>{welch}<br>{tost}{within}</small>")
}

/// Formats the mean and standard deviation of position errors. Those of exact slicing are rounding errors.
fn mean_and_sd(summary: &SampleSummary) -> String {
    if summary.mean < 5e-6 {
        format!("{:.0e}", summary.mean)
    } else {
        format!("{:.4} &plusmn; {:.4}", summary.mean, summary.sd)
    }
}

fn tests(page: &mut String, of: &Reproduction) {
    if of.comparison.questions.is_empty() {
        return;
    }
    page.push_str(
        "<h2 id=\"tests\">Do groups differ by more than chance?</h2>\n\
         <p>p is the probability of a difference at least as large as the one found if the groups do not differ. The \
         paper quotes p-values of the &#8220;mean rank of each group&#8221;, which is the test of Kruskal and Wallis. \
         For noise and for constant k the paper also names one-way analysis of variance (ANOVA), with results only in \
         its supplement, so its p-values are shown, too. Each p-value depends on the random poses that were drawn. A \
         large p does not prove that groups are alike, but only that this number of growths does not show a \
         difference. These p-values are not corrected for the number of tests.</p>\n",
    );
    let quoted: Vec<&SignificanceTest> =
        of.comparison.questions.iter().filter(|question| question.paper.is_some()).collect();
    let others: Vec<&SignificanceTest> =
        of.comparison.questions.iter().filter(|question| question.paper.is_none()).collect();
    for (title, questions) in [("Quoted in the text", quoted), ("Named in the text, without numbers", others)] {
        if questions.is_empty() {
            continue;
        }
        let mut table = Table::new(NumberFormat::Plain)
            .column("what", |question: &SignificanceTest| capital(&question.what))
            .column("path", |question| question.planner.name())
            .column("layers", |question| question.slicing.clone());
        if questions.iter().any(|question| question.paper.is_some()) {
            table = table.column("the paper", |question| question.paper.map(|p| format!("{p:.4}")));
        }
        table = table
            .column("Kruskal-Wallis", |question| p_cell(question.kruskal_wallis))
            .column("ANOVA", |question| p_cell(question.anova))
            .column("groups", |question| question.groups)
            .column("n", |question| question.n);
        let _ = write!(page, "<h3>{title}</h3>\n{}", table.grouped_html(questions, 3));
    }
}

fn p_cell(test: Option<TestResult>) -> String {
    test.map_or_else(|| "-".to_owned(), |test| p_text(test.p).replace('<', "&lt;"))
}

/// Writes the comparison of open and closed loop, with noise and between random poses.
fn feedback(page: &mut String, of: &Reproduction) {
    let noisy: Vec<&GrowthSet> = of.experiments.sets.iter().filter(|set| set.condition.noise > 0.0).collect();
    if noisy.is_empty() {
        return;
    }
    let _ = writeln!(
        page,
        "<h2 id=\"feedback\">With noise: open and closed loop</h2>\n<p>Robot A grows between the same random \
         poses with exact slicing and uniform noise of &plusmn;{} % of the growth of each layer. Each layer has the \
         same error of growth in both loops. The tilt of layers has no error, so the direction is right in open loop. \
         The paper names feedback as future work. Without noise of the growth, only the noise of the sensors is left, \
         and open loop with exact slicing has smaller errors than closed loop: see Figure 6.</p>",
        100.0 * NOISE_OF_FEEDBACK
    );
    let errors = Table::new(NumberFormat::Plain)
        .column("distance", |set: &GrowthSet| format!("{} R", GROUPS[set.group]))
        .column("path", |set| set.condition.planner.name())
        .column("loop", |set| set.condition.loop_name())
        .columns(["position error / length", "95th percentile"], |set| {
            let SampleSummary { mean, sd, p95, .. } = set.summary(ErrorQuantity::Position);
            [format!("{} &plusmn; {}", error_text(mean), error_text(sd)), error_text(p95)]
        })
        .columns(["direction error, deg", "95th percentile"], |set| {
            let SampleSummary { mean, sd, p95, .. } = set.summary(ErrorQuantity::Direction);
            [format!("{} &plusmn; {}", degrees_text(mean), degrees_text(sd)), degrees_text(p95)]
        });
    let groups = 0..GROUPS.len();
    let noisy = &noisy;
    let rows = groups
        .flat_map(|group| noisy.iter().copied().filter(move |set| set.group == group && set.robot == paper::ROBOT_A));
    *page += &errors.grouped_html(rows, 3);
}

/// Formats an angle. A rounding error becomes 0.
fn degrees_text(degrees: f64) -> String {
    if degrees < 5e-4 { "0".to_owned() } else { format!("{degrees:.3}") }
}

fn caption(figure: u8) -> &'static str {
    match figure {
        4 => {
            "The dots of the paper&#8217;s figure are not published as numbers, so our dots are compared with the \
             paper&#8217;s means and standard deviations from Table 2 and from the text. The length of a path does not \
             depend on how it is sliced."
        }
        5 => {
            "The upper row shows the planned paths. The lower row shows the bodies that are grown along these paths by \
             whole steps of 3.096 mm, with the planned paths drawn over them. The paper chose representative growths \
             between its own random poses; these growths between our poses were chosen by the same rule. Times are \
             computed from the growth velocity g = 0.043 mm/s."
        }
        6 => {
            "The paper finds that noise has a stronger effect over short distances. With whole steps, the error of \
             rounding up is larger than that of the noise and hides the effect of noise; noise may even reduce the \
             error. Exact slicing shows the effect of noise alone. The paper gives its numbers only in its supplement."
        }
        7 => {
            "Two examples, as in the paper. Times are computed from the growth velocities: 0.12 mm/s for robot B and \
             10 m/s for robot C."
        }
        _ => {
            "Panel D shows our errors at the bend of a step that was laid, and the paper&#8217;s errors at the k that \
             the paper prints. Our errors are in proportion to k for both steps, so they lie on one line. The \
             paper&#8217;s errors of A to A8 are a factor of four beside this line, because the paper computes k from \
             the step of Table 1; its error of B lies far below the line."
        }
    }
}
