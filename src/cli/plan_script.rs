//! Scripts that convert in parts by an engine, which the user has.

use super::output;
use clap::ValueEnum;
use serde_json::json;
use std::path::Path;

/// An engine that runs many jobs.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum Engine {
    /// Slurm: arrays of jobs
    Slurm,
    /// HyperQueue: arrays of tasks
    Hq,
    /// Kubernetes: an indexed Job
    K8s,
    /// AWS Batch: array jobs
    Batch,
    /// Nextflow: a process for each part
    Nextflow,
}

/// What a script has to know.
pub struct Script<'a> {
    /// The directory of the plan.
    pub out: &'a Path,
    /// How many parts there are.
    pub parts: u32,
    /// The limit of memory of a part.
    pub memory: u64,
    /// Threads of a part.
    pub threads: usize,
}

/// What comes around a round in a shell: `submit` runs the parts in `$todo`.
fn looped(merge: &str, submit: &str) -> String {
    format!(
        "#!/bin/sh\n\
         # Converts in parts: rounds of jobs, and a merge between them. It can be stopped and run again at any time.\n\
         tries=0\n\
         while :; do\n  \
           todo=$({merge}) && exit 0\n  \
           [ $? -eq 3 ] || exit 2\n  \
           # rounds have the same list; a part that fails again and again has it more often\n  \
           if [ \"$todo\" = \"$before\" ]; then tries=$((tries + 1)); else tries=0; fi\n  \
           [ $tries -lt 10 ] || {{ echo \"parts $todo fail\" >&2; exit 2; }}\n  \
           before=$todo\n\
         {submit}\n\
         done\n"
    )
}

impl Script<'_> {
    fn out(&self) -> String {
        output::shell_word(self.out.as_os_str())
    }

    fn mib(&self) -> u64 {
        self.memory.div_ceil(1 << 20)
    }

    /// More than the limit: some of the page cache counts for many engines.
    fn mib_of_job(&self) -> u64 {
        self.mib() + self.mib() / 4
    }

    /// The command line of a part.
    pub fn work(&self, part: &str) -> String {
        format!("alvis work {} --part {part}", self.out())
    }

    /// The command line between rounds.
    pub fn merge(&self) -> String {
        format!("alvis merge {}", self.out())
    }

    fn job(&self, part: &str) -> String {
        let (work, mib, threads) = (self.work(part), self.mib(), self.threads);
        format!("{work} --memory {mib}MiB --threads {threads}")
    }

    /// The script for an engine.
    pub fn text(&self, engine: Engine) -> String {
        let (mib, merge, threads) = (self.mib_of_job(), self.merge(), self.threads);
        match engine {
            Engine::Slurm => looped(
                &merge,
                &format!(
                    "  sbatch --wait --array=\"$todo\" --cpus-per-task={threads} --mem={mib}M --wrap {} || true",
                    quoted(&self.job("$SLURM_ARRAY_TASK_ID"))
                ),
            ),
            Engine::Hq => looped(
                &merge,
                &format!(
                    "  hq submit --wait --array=\"$todo\" --cpus={threads} -- sh -c {} || true",
                    quoted(&self.job("$HQ_TASK_ID"))
                ),
            ),
            Engine::K8s => self.kubernetes(),
            Engine::Batch => self.batch(),
            Engine::Nextflow => self.nextflow(),
        }
    }

    fn kubernetes(&self) -> String {
        let (parts, mib, threads) = (self.parts, self.mib_of_job(), self.threads);
        let job = self.job("$JOB_COMPLETION_INDEX");
        let submit = format!(
            r#"  name=alvis-$(date +%s)
  kubectl create -f - <<END
apiVersion: batch/v1
kind: Job
metadata: {{name: $name}}
spec:
  completionMode: Indexed
  completions: {parts}
  parallelism: 20
  backoffLimit: {parts}
  template:
    spec:
      restartPolicy: Never
      containers:
      - name: work
        # an image with alvis, and the volume claim that holds the plan
        image: ALVIS_IMAGE
        command: [sh, -c, 'x=0; {job} || x=\$?; [ \$x -eq 75 ] || exit \$x']
        resources: {{requests: {{cpu: {threads}, memory: {mib}Mi}}, limits: {{memory: {mib}Mi}}}}
        volumeMounts: [{{name: data, mountPath: /data}}]
      volumes: [{{name: data, persistentVolumeClaim: {{claimName: DATA_CLAIM}}}}]
END
  until kubectl get job/$name -o jsonpath='{{.status.conditions[*].type}}' | grep -Eq 'Complete|Failed'; do sleep 5; done"#,
            // quoted once for YAML, and once for the document in the shell
            job = job
                .replace('\'', "''")
                .replace('\\', r"\\")
                .replace('`', r"\`")
                .replace('$', r"\$")
        );
        looped(&self.merge(), &submit)
    }

    fn batch(&self) -> String {
        let parts = self.parts;
        // a Batch array has at least two jobs
        let size = parts.max(2);
        let job = self.job("$AWS_BATCH_JOB_ARRAY_INDEX");
        let command =
            format!("[ $AWS_BATCH_JOB_ARRAY_INDEX -ge {parts} ] || {job} || [ $? -eq 75 ]");
        let overrides = json!({"command": ["sh", "-c", command]}).to_string();
        let submit = format!(
            "  # a queue, and a definition of jobs with alvis and the file system that holds the plan\n  \
             id=$(aws batch submit-job --job-name alvis --job-queue ALVIS_QUEUE --job-definition ALVIS_JOB \
             --array-properties size={size} --container-overrides {} --query jobId --output text)\n  \
             while sleep 20; do\n    \
               state=$(aws batch describe-jobs --jobs \"$id\" --query 'jobs[0].status' --output text)\n    \
               case $state in SUCCEEDED|FAILED) break;; esac\n  \
             done",
            quoted(&overrides)
        );
        looped(&self.merge(), &submit)
    }

    fn nextflow(&self) -> String {
        let (mib, threads) = (self.mib_of_job(), self.threads);
        // all but the number of the part is text for Groovy
        let job = self.job("PART").replace('\\', r"\\");
        let job = job.replace('"', "\\\"").replace('$', r"\$");
        let job = match job.rsplit_once("PART") {
            Some((before, after)) => format!("{before}$k{after}"),
            None => job,
        };
        let submit = format!(
            r#"  cat > alvis-parts.nf <<'END'
params.todo = ''
def numbers(text) {{
  text.tokenize(',').collectMany {{ run -> def ends = run.tokenize('-')*.toInteger(); (ends[0]..ends[-1]).toList() }}
}}
process work {{
  cpus {threads}
  memory '{mib} MB'
  // what fails is in the list of the next merge again
  errorStrategy 'ignore'
  input: val k
  script: "cd '${{launchDir}}' && {job}"
}}
workflow {{ work(channel.fromList(numbers("${{params.todo}}"))) }}
END
  nextflow run alvis-parts.nf --todo "$todo" || true"#
        );
        looped(&self.merge(), &submit)
    }
}

/// A command line as one word of another.
fn quoted(line: &str) -> String {
    format!("'{}'", line.replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::{Command, Stdio};

    /// The scripts for a directory whose name has to be quoted.
    fn script(engine: Engine) -> String {
        Script {
            out: Path::new("a dir/it's"),
            parts: 3,
            memory: 1 << 30,
            threads: 8,
        }
        .text(engine)
    }

    #[test]
    fn scripts_are_sound_for_the_shell() {
        for &engine in Engine::value_variants() {
            let text = script(engine);
            let mut shell = Command::new("sh")
                .args(["-n", "-s"])
                .stdin(Stdio::piped())
                .spawn()
                .unwrap();
            let mut input = shell.stdin.take().unwrap();
            std::io::Write::write_all(&mut input, text.as_bytes()).unwrap();
            drop(input);
            assert!(shell.wait().unwrap().success(), "{engine:?}: {text}");
        }
    }

    /// What a script hands to its engine, whose commands `stubs` are; the loop goes once.
    fn handed_on(engine: Engine, stubs: &str) -> String {
        let dir = tempfile::tempdir().unwrap();
        let alvis = "alvis() { [ -e done ] && return 0; touch done; echo 0-2; return 3; }";
        let text = format!("sleep() {{ :; }}\n{alvis}\n{stubs}\n{}", script(engine));
        let mut shell = Command::new("sh");
        shell.arg("-c").arg(text).current_dir(dir.path());
        let ended = shell.status().unwrap();
        assert!(ended.success());
        std::fs::read_to_string(dir.path().join("handed")).unwrap()
    }

    /// The words of the command of a part, as its shell runs it.
    fn words(command: &str) -> Vec<String> {
        let text = format!("alvis() {{ printf '%s\\n' \"$@\"; }}\n{command}");
        let ran = Command::new("sh").arg("-c").arg(text).output().unwrap();
        let said = String::from_utf8(ran.stdout).unwrap();
        said.lines().map(str::to_owned).collect()
    }

    #[test]
    fn names_of_directories_come_through_all_quotes() {
        let yaml = handed_on(
            Engine::K8s,
            "kubectl() { if [ $1 = create ]; then cat >handed; else echo Complete; fi; }",
        );
        let (_, rest) = yaml.split_once("command: [sh, -c, '").unwrap();
        let (of_pod, _) = rest.split_once("']\n").unwrap();
        let of_pod = of_pod.replace("''", "'");
        let json = handed_on(
            Engine::Batch,
            "aws() { case $2 in submit-job) shift 11; printf %s \"$1\" >handed; echo 7;; *) echo FAILED;; esac; }",
        );
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        let of_batch = json["command"][2].as_str().unwrap();
        let of_slurm = handed_on(
            Engine::Slurm,
            "sbatch() { shift 5; printf %s \"$1\" >handed; }",
        );
        for command in [&of_pod[..], of_batch, &of_slurm] {
            let words = words(command);
            assert_eq!(words[..2], ["work", "a dir/it's"], "{command}");
        }
    }

    #[test]
    fn every_script_has_both_commands() {
        for &engine in Engine::value_variants() {
            let text = script(engine);
            assert!(
                text.contains("alvis work") && text.contains("alvis merge"),
                "{text}"
            );
        }
    }
}
